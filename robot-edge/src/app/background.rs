//! Which threads go first.

/// How much nicer mapping is than what drives and speaks to the network: the scheduler gives a thread three times as much
/// as one that is nicer by five, and wakes it sooner.
#[cfg(target_os = "linux")]
const NICER: i32 = 5;

/// Makes this thread, and those that it starts from now on, give way to those that run already.
///
/// To raise the others would need a privilege; giving way needs none.
#[cfg(target_os = "linux")]
pub(super) fn give_way() {
    // On Linux it is the thread's, not the process's.
    if let Err(error) = rustix::process::nice(NICER) {
        tracing::warn!(%error, "mapping cannot give way to driving");
    }
}

/// Nothing: elsewhere threads have no such thing.
#[cfg(not(target_os = "linux"))]
pub(super) const fn give_way() {}
