//! A simulated robot is driven under failures and attacks; its motor outputs are compared with the commands of its
//! operators.

mod collision;
mod cuts;
mod docking;
pub(crate) mod figures;
mod kills;
mod machine;
mod other_operators;
pub(crate) mod robot;
mod touch;
