//! Panels beside the map: plain data (`FooData`) made from the model, drawn by a function that returns commands.

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
pub mod timeline;
pub mod top_bar;
