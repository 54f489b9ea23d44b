//! A simulated robot is driven under failures and attacks; its motor outputs are compared with the commands of its
//! operators.

mod collision;
mod cuts;
mod docking;
mod figures;
mod kills;
mod machine;
mod other_operators;
mod robot;
mod touch;
