//! The program's code is in memory before it runs.

#![cfg(test)]
#![cfg(target_os = "linux")]

use std::fs;

use network::program_code::load_program;

/// Kilobytes of code of this program, and how many of them are in memory.
fn code() -> [u64; 2] {
    let program = fs::read_link("/proc/self/exe").unwrap();
    let maps = fs::read_to_string("/proc/self/smaps").unwrap();
    let lines = maps.lines();
    let mut lines = lines
        .skip_while(|line| !line.contains(" r-xp ") || !line.ends_with(program.to_str().unwrap()));
    ["Size:", "Rss:"].map(|field| {
        let line = lines.find(|line| line.starts_with(field)).unwrap();
        let kilobytes = line.split_whitespace().nth(1).unwrap();
        kilobytes.parse().unwrap()
    })
}

#[test]
fn all_code_is_in_memory_once_it_is_loaded() {
    let [all, before] = code();
    load_program();
    assert!(before < all, "{before} of {all} kB");
    assert_eq!(code(), [all, all]);
}
