//! Which threads go first.

/// How much nicer mapping is than driving and the network (sched(7)): the scheduler wakes those first. The shipped unit
/// starts the program with a nice value of −10, so that mapping is at 0 there.
#[cfg(target_os = "linux")]
const NICE_INCREMENT: i32 = 10;

/// Makes this thread, and those that it starts from now on, give way to those that run already.
///
/// To raise the others would need a privilege; giving way needs none.
#[cfg(target_os = "linux")]
pub(super) fn lower_thread_priority() {
    // On Linux it is the thread's, not the process's.
    if let Err(error) = rustix::process::nice(NICE_INCREMENT) {
        tracing::warn!(%error, "mapping cannot give way to driving");
    }
}

/// Nothing: elsewhere threads have no such thing.
#[cfg(not(target_os = "linux"))]
pub(super) const fn lower_thread_priority() {}
