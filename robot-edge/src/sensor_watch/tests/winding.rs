//! Data that is wound, or played again.

use super::*;

#[test]
fn data_that_is_wound_has_no_fault_by_that() {
    let mut watch = laser(Some(10.0));
    let mut faults = Vec::new();
    let mut lap = |watch: &mut SensorWatch, from_ms: u64| {
        for ms in (from_ms..116_000).step_by(100) {
            watch.take(&sweep(ms, 3.0), at(ms));
            faults.extend(fault(watch, ms));
        }
    };
    // From the end to the beginning and, both ways, to what lies between.
    lap(&mut watch, 0);
    for to_ms in [0, 50_000, 90_000] {
        watch.look(at(116_000));
        watch.wind(at(to_ms));
        assert!(watch.is_look_due(at(to_ms)));
        assert_eq!(fault(&watch, to_ms + 2_900), None, "its first word");
        assert_eq!(fault(&watch, to_ms + 3_000), Some(SensorFault::Silent));
        lap(&mut watch, to_ms);
    }
    assert_eq!(faults, []);
    let messages = 1_160 + 1_160 + 660 + 260;
    assert_eq!(watch.statuses(at(116_000))[0].messages, messages);
}
