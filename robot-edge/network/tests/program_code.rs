//! The program is in memory before it runs.

#![cfg(test)]
#![cfg(target_os = "linux")]

use std::fs;
use std::ops::Range;

use network::program_code::load_program;

/// A part of this program that nothing reads.
static UNREAD: [u8; 8 << 20] = [1; 8 << 20];

/// Addresses of a mapping in the line before its figures (smaps of proc(5)).
fn addresses(line: &str) -> Option<Range<usize>> {
    let (from, rest) = line.split_once('-')?;
    let (to, _) = rest.split_once(' ')?;
    let [from, to] = [from, to].map(|place| usize::from_str_radix(place, 16).ok());
    Some(from?..to?)
}

/// Kilobytes of the mapping of [`UNREAD`], and how many of them are in memory.
fn mapping() -> [u64; 2] {
    let place = UNREAD.as_ptr().addr();
    let maps = fs::read_to_string("/proc/self/smaps").unwrap();
    let is_it = |line: &&str| addresses(line).is_some_and(|range| range.contains(&place));
    let mut lines = maps.lines().skip_while(|line| !is_it(line));
    ["Size:", "Rss:"].map(|field| {
        let line = lines.find(|line| line.starts_with(field)).unwrap();
        let kilobytes = line.split_whitespace().nth(1).unwrap();
        kilobytes.parse().unwrap()
    })
}

#[test]
fn what_was_never_read_is_in_memory_once_the_program_is_loaded() {
    let [all, before] = mapping();
    load_program();
    assert!(before < all - 6000, "{before} of {all} kB");
    assert_eq!(mapping(), [all, all]);
}
