//! A simulated robot is driven while everything goes wrong that can, and what its motors were told is held against what
//! its operator sent.

mod at_the_vehicle;
mod collision;
mod cuts;
mod drive;
mod figures;
mod kills;
mod machine;
mod nearly_full;
mod open_water;
mod quic;
mod robot;
mod shaped_figures;
mod stalls;
mod strangers;
