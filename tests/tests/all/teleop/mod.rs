//! A simulated robot is driven under failures and attacks; its motor outputs are compared with the commands of its
//! operators.

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
