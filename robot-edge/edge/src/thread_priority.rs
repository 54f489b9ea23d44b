//! The priority of the threads that driving and the network must not wait for.

/// Increment of the nice value of mapping relative to driving and the network (sched(7)). The shipped unit starts the program
/// with a nice value of −10, so that mapping is at 0 there.
#[cfg(target_os = "linux")]
const NICE_INCREMENT: i32 = 10;

/// Lowers the priority of this thread and of those that it starts later. Raising the others would need a privilege.
#[cfg(target_os = "linux")]
pub(crate) fn lower_thread_priority() {
    // On Linux the nice value belongs to the thread, not to the process.
    if let Err(error) = rustix::process::nice(NICE_INCREMENT) {
        tracing::warn!(%error, "mapping cannot give way to driving");
    }
}

/// Does nothing: other systems have no priority per thread.
#[cfg(not(target_os = "linux"))]
pub(crate) const fn lower_thread_priority() {}
