//! Commands of the operator for a recording.

use edge::pacer::Rate;
use edge::replay_control::{ReplayControl, ReplayState, ReplayStatus};
use measurement::time::RobotDuration;

pub const RATES: [Rate; 7] = [
    Rate::Times(0.25),
    Rate::Times(0.5),
    Rate::Times(1.0),
    Rate::Times(2.0),
    Rate::Times(5.0),
    Rate::Times(10.0),
    Rate::Max,
];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaybackCommand {
    Play,
    Pause,
    PlayOrPause,
    SetRate(Rate),
    Slower,
    Faster,
    SetLooping(bool),
    ToggleLooping,
    Seek(RobotDuration),
    Step(RobotDuration),
    Close,
}

impl PlaybackCommand {
    pub(super) fn apply_to(self, control: &ReplayControl) -> bool {
        match self {
            Self::Play => control.play(),
            Self::Pause => control.pause(),
            Self::PlayOrPause => {
                if is_playing(&control.status()) {
                    control.pause();
                } else {
                    control.play();
                }
            }
            Self::SetRate(rate) => control.set_rate(rate),
            Self::Slower => control.set_rate(neighbour(control.status().rate, false)),
            Self::Faster => control.set_rate(neighbour(control.status().rate, true)),
            Self::SetLooping(is_looping) => control.set_looping(is_looping),
            Self::ToggleLooping => control.set_looping(!control.status().is_looping),
            Self::Seek(to) => control.seek(to),
            Self::Step(by) => control.step(by),
            Self::Close => return false,
        }
        true
    }
}

pub fn is_playing(status: &ReplayStatus) -> bool {
    !status.is_paused && status.state != ReplayState::Ended
}

fn neighbour(rate: Rate, is_faster: bool) -> Rate {
    let speed = |rate: Rate| match rate {
        Rate::Times(times) => times,
        Rate::Max => f64::INFINITY,
    };
    let next = if is_faster {
        RATES.into_iter().find(|other| speed(*other) > speed(rate))
    } else {
        let mut slower = RATES.into_iter().rev();
        slower.find(|other| speed(*other) < speed(rate))
    };
    next.unwrap_or(rate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn toggle_plays_pauses_and_restarts() {
        let control = ReplayControl::new(Rate::Times(1.0));
        for is_paused in [true, false, true] {
            assert!(PlaybackCommand::PlayOrPause.apply_to(&control));
            assert_eq!(control.status().is_paused, is_paused);
        }
        let ended = ReplayStatus {
            state: ReplayState::Ended,
            is_paused: false,
            ..control.status()
        };
        assert!(!is_playing(&ended), "it is played from the beginning");
    }

    #[test]
    fn rate_and_loop_commands_are_relative() {
        let control = ReplayControl::new(Rate::Times(1.0));
        for (command, rate) in [
            (PlaybackCommand::Faster, 2.0),
            (PlaybackCommand::Faster, 5.0),
            (PlaybackCommand::Slower, 2.0),
        ] {
            assert!(command.apply_to(&control));
            assert_eq!(control.status().rate, Rate::Times(rate));
        }
        for is_looping in [true, false] {
            assert!(PlaybackCommand::ToggleLooping.apply_to(&control));
            assert_eq!(control.status().is_looping, is_looping);
        }
        assert!(!PlaybackCommand::Close.apply_to(&control));
    }

    #[test]
    fn speeds_have_neighbours() {
        let chain = |is_faster: bool, mut rate: Rate| {
            for _ in 0..10 {
                rate = neighbour(rate, is_faster);
            }
            rate
        };
        assert_eq!(chain(true, RATES[0]), Rate::Max);
        assert_eq!(chain(false, Rate::Max), RATES[0]);
        assert_eq!(neighbour(Rate::Times(3.0), true), Rate::Times(5.0));
        assert_eq!(neighbour(Rate::Times(3.0), false), Rate::Times(2.0));
    }
}
