//! `robot-edge`: see `robot-edge --help`.

fn main() {}
