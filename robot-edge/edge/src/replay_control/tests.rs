use super::*;
use network::clock;

const fn ms(ms: i64) -> RobotDuration {
    RobotDuration::from_millis(ms)
}

fn at(position: RobotDuration, has_ended: bool) -> ReplayControl {
    let control = ReplayControl::new(Rate::Times(1.0));
    control.report_progress(
        ReplayProgress {
            is_opening: false,
            position,
            seeking: None,
            has_ended,
            is_settled: has_ended,
        },
        Some(0.98),
    );
    control.set_length(Length {
        duration: ms(116_000),
        is_estimate: false,
    });
    control
}

#[test]
fn what_is_wanted_is_seen_at_once() {
    let control = ReplayControl::new(Rate::Times(1.0));
    assert_eq!(control.status().state, ReplayState::Opening);
    let control = at(ms(5_000), false);
    let status = control.status();
    assert_eq!(status.state, ReplayState::Playing);
    assert_eq!(status.rate_reached, Some(0.98));
    control.pause();
    let status = control.status();
    assert_eq!(
        (status.state, status.rate_reached),
        (ReplayState::Paused, None)
    );
    assert!(!status.is_settled, "nobody has stopped yet");
    control.seek(ms(60_000));
    let to = ms(60_000);
    assert_eq!(control.status().state, ReplayState::Seeking { to });
    assert_eq!(control.take_commands().seek, Some(to));
    assert_eq!(control.take_commands().seek, None);
    assert_eq!(control.status().state, ReplayState::Seeking { to });
}

#[test]
fn steps_add_up_and_stay_within_the_recording() {
    let control = at(ms(5_000), false);
    for (by, to) in [(1, 6), (10, 16), (-1, 15), (-100, 0), (1, 1), (500, 116)] {
        control.step(ms(1000 * by));
        let to = ms(1000 * to);
        assert_eq!(control.status().state, ReplayState::Seeking { to });
    }
    control.take_commands();
    control.step(ms(-1000));
    assert_eq!(
        control.take_commands().seek,
        Some(ms(115_000)),
        "while it is wound"
    );
}

#[test]
fn who_plays_at_the_end_begins_anew() {
    let control = at(ms(116_000), true);
    assert_eq!(control.status().state, ReplayState::Ended);
    assert!(control.status().is_settled);
    control.play();
    assert_eq!(control.take_commands().seek, Some(ms(0)));

    let paused = at(ms(5_000), false);
    paused.pause();
    paused.play();
    assert_eq!(paused.take_commands().seek, None);
    assert_eq!(paused.status().state, ReplayState::Playing);
}

#[test]
fn what_is_wound_from_the_end_stands_still_unless_it_was_to_go_on() {
    let end = ms(116_000);
    let wound = |prepare: fn(&ReplayControl)| {
        let control = at(end, true);
        prepare(&control);
        control.step(ms(-1000));
        let commands = control.take_commands();
        (commands.is_paused, commands.seek)
    };
    assert_eq!(wound(|_| {}), (true, Some(ms(115_000))));
    // There is nothing behind the end.
    let behind = at(end, true);
    behind.step(ms(1000));
    assert_eq!(behind.status().state, ReplayState::Ended);
    assert!(!behind.status().is_paused, "it would not go round any more");
    // It loops in any case, and was not paused.
    let loops = wound(|control| control.set_looping(true));
    assert_eq!(loops, (false, Some(ms(115_000))));
    assert_eq!(wound(ReplayControl::play), (false, Some(ms(0))));
    let playing = at(ms(5_000), false);
    playing.seek(end);
    assert!(!playing.take_commands().is_paused);
}

#[test]
fn rates_are_kept_within_their_limits() {
    let control = at(ms(0), false);
    for (wanted, kept) in [(0.01, 0.1), (0.25, 0.25), (20.0, 20.0), (1e9, 20.0)] {
        control.set_rate(Rate::Times(wanted));
        assert_eq!(control.status().rate, Rate::Times(kept));
    }
    control.set_rate(Rate::Max);
    assert_eq!(control.status().rate, Rate::Max);
}

#[test]
fn a_wish_wakes_who_sleeps() {
    let control = at(ms(0), false);
    let known = control.take_commands();
    let far = clock::now() + Duration::from_hours(1);
    let sleeper = std::thread::spawn({
        let control = control.clone();
        move || control.sleep_until(far, known, || false)
    });
    control.pause();
    assert!(!sleeper.join().unwrap());
    let (now, known) = (clock::now(), control.take_commands());
    assert!(control.sleep_until(now, known, || false));
    assert!(!control.sleep_until(far, known, || true), "interrupted");
}

#[test]
fn a_guess_of_the_length_gives_way_to_what_is_known() {
    let control = ReplayControl::new(Rate::Max);
    let length = |s: i64, is_estimate| Length {
        duration: ms(1000 * s),
        is_estimate,
    };
    control.set_length(length(100, true));
    control.seek(ms(500_000));
    assert_eq!(
        control.take_commands().seek,
        Some(ms(500_000)),
        "it may be longer"
    );
    control.set_length(length(120, false));
    control.set_length(length(90, true));
    assert_eq!(control.status().length, Some(length(120, false)));
}
