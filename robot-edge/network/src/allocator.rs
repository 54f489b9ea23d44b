//! Setting of the C library's allocator.

/// Keeps little memory that was freed: one heap for all threads, and large blocks go back to the system. To be called first in `main`,
/// before there are other threads.
///
/// glibc has up to eight heaps for each processor. Each keeps what its threads once needed, and with links that come and go the threads
/// change. Each QUIC connection also has 3 MB to receive into: once one such block was freed, glibc takes the next ones from a
/// heap and keeps them there (mallopt(3), `M_ARENA_MAX` and `M_MMAP_THRESHOLD`). Other libraries and systems are left as they are.
pub fn keep_little_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "mallopt has no safe interface")]
    // SAFETY: the values are valid, and glibc locks its heap while it sets them. Where it fails, more memory is kept.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, 1);
        // Less than what QUIC takes, and more than most blocks of maps: each use of mapped memory costs page faults.
        libc::mallopt(libc::M_MMAP_THRESHOLD, 2_800_000);
        // As glibc itself would set it after such a block was freed; else heaps would be trimmed at 128 kB, which costs page faults.
        libc::mallopt(libc::M_TRIM_THRESHOLD, 6 << 20);
    }
}
