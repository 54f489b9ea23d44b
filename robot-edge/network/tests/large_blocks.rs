//! Memory after large blocks were freed.

#![cfg(test)]
#![cfg(all(target_os = "linux", target_env = "gnu"))]

use std::fs;
use std::sync::Barrier;
use std::thread;

use network::allocator::keep_little_memory;

/// As many as glibc has heaps, if it is not told otherwise, on a machine of two cores.
const THREADS: usize = 16;
/// What a QUIC connection receives into.
const BLOCK: usize = 3_014_656;

fn memory() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let (_, resident) = status.split_once("VmRSS:").unwrap();
    let kilobytes = resident.split_whitespace().next().unwrap();
    1024 * kilobytes.parse::<usize>().unwrap()
}

#[test]
fn large_blocks_of_many_threads_are_returned() {
    keep_little_memory();
    let before = memory();
    let together = Barrier::new(THREADS);
    let after = thread::scope(|scope| {
        let allocate = || {
            for value in [1_u8, 2] {
                let block = vec![value; BLOCK];
                let sum: usize = block.iter().copied().map(usize::from).sum();
                assert_eq!(sum, usize::from(value) * BLOCK);
            }
            together.wait();
            memory()
        };
        let threads: Vec<_> = (0..THREADS).map(|_| scope.spawn(allocate)).collect();
        let after = threads.into_iter().map(|one| one.join().unwrap());
        after.max().unwrap()
    });
    assert!(after < before + 2 * BLOCK, "{before} to {after} bytes");
}
