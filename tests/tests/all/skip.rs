//! Skipped tests. The edge's own tests include this file.

/// Set by `.ci/nightly`.
const NIGHTLY: &str = "FORESHORE_NIGHTLY";

/// Prints that a test is skipped: what it lacks, and what provides it (a package, a right, a variable). Fails the test if
/// [`NIGHTLY`] is set.
#[track_caller]
pub(crate) fn skip(lacks: &str, remedy: &str) {
    assert!(
        std::env::var_os(NIGHTLY).is_none(),
        "{NIGHTLY} is set and this test cannot run: {lacks} ({remedy})"
    );
    println!("skipped: {lacks} ({remedy})");
}
