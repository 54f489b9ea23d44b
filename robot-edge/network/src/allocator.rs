//! Setting of the C library's allocator.

/// Returns large blocks of memory to the system as soon as they are freed. To be called first in `main`, before there are heaps of threads.
///
/// Each QUIC connection has 3 MB to receive into. Once it has freed one such block, glibc takes the next ones from the heap of the thread
/// that connects and keeps them there: 3 MB more each time another thread does, as links come and go (mallopt(3), `M_MMAP_THRESHOLD`).
/// Other libraries and systems are left as they are.
pub fn return_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "mallopt has no safe interface")]
    // SAFETY: the values are valid, and glibc locks its heap while it sets them. Where it fails, more memory is kept.
    unsafe {
        // Less than what QUIC takes, and more than most blocks of maps: each use of mapped memory costs page faults.
        libc::mallopt(libc::M_MMAP_THRESHOLD, 2_800_000);
        // As glibc itself would set it after such a block was freed; else heaps would be trimmed at 128 kB, which costs page faults.
        libc::mallopt(libc::M_TRIM_THRESHOLD, 6 << 20);
    }
}
