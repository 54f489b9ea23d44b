//! Panels beside the map. Each has plain data (`FooData`), made from the model, and a function that draws it and
//! returns commands.

pub mod address_list;
pub mod addresses;
pub mod alerts;
pub mod connection;
pub mod data_age;
pub mod driving;
pub mod events;
pub mod formatting;
pub mod layers;
pub mod legend;
pub mod link;
pub mod losses;
pub mod notice;
pub mod recording;
pub mod robot;
pub mod robots;
mod rows;
pub mod sensors;
pub mod shores;
pub mod stale;
pub mod timeline;
pub mod top_bar;
