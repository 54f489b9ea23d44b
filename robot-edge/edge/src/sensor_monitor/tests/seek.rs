//! Data that is wound, or played again.

use super::*;

#[test]
fn data_that_is_wound_has_no_fault_by_that() {
    let mut monitor = laser(Some(10.0));
    let mut faults = Vec::new();
    let mut lap = |monitor: &mut SensorMonitor, from_ms: u64| {
        for ms in (from_ms..116_000).step_by(100) {
            monitor.take(&sweep(ms, 3.0), at(ms));
            faults.extend(fault(monitor, ms));
        }
    };
    // From the end to the beginning and, both ways, to what lies between.
    lap(&mut monitor, 0);
    for to_ms in [0, 50_000, 90_000] {
        monitor.check(at(116_000));
        monitor.seek(at(to_ms));
        assert!(monitor.is_check_due(at(to_ms)));
        assert_eq!(fault(&monitor, to_ms + 2_900), None, "its first word");
        assert_eq!(fault(&monitor, to_ms + 3_000), Some(SensorFault::Silent));
        lap(&mut monitor, to_ms);
    }
    assert_eq!(faults, []);
    let messages = 1_160 + 1_160 + 660 + 260;
    assert_eq!(monitor.statuses(at(116_000))[0].messages, messages);
}
