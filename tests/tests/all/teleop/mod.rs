//! A simulated robot is driven while everything goes wrong that can, and what its motors were told is held against what
//! its operator sent.

mod at_the_vehicle;
mod collision;
mod cuts;
mod drive;
mod figures;
mod kills;
mod machine;
mod nearly_full_disk;
mod open_water;
mod other_operators;
mod quic;
mod robot;
mod shaped_figures;
mod stalls;
