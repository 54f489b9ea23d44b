//! What the hand does, frame by frame, and how long frames take meanwhile.

use std::time::Duration;

use eframe::egui::{
    Event, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, TouchPhase, pos2, vec2,
};
use measurement::time::Monotonic;
use operator_console::command::Look;
use operator_console::map_view::{MapView, Orientation};
use robot_edge::clock;

const FRAMES: usize = 300;
/// A hand that is in a hurry: 40 points a frame are a screen in half a second.
const DRAG: f32 = 40.0;
const HOLD: Pos2 = pos2(700.0, 300.0);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    Rest,
    PanWhole,
    PanMiddle,
    PanClose,
    PanTurned,
    Zoom,
    Still,
    Update,
}

const ORDER: [(Step, &str); 8] = [
    (Step::Rest, "whole map, nothing moves"),
    (Step::PanWhole, "pan, whole map"),
    (Step::PanMiddle, "pan, 1 pixel = 4 cells"),
    (Step::PanClose, "pan, 1 pixel = 1 cell"),
    (Step::PanTurned, "pan, 1 pixel = 1 cell, robot up"),
    (Step::Zoom, "zoom in and out by the wheel"),
    (Step::Still, "elevation 401x401, no change"),
    (Step::Update, "elevation 401x401, all new"),
];

#[derive(Default)]
pub(crate) struct Steps {
    step: usize,
    index: usize,
    is_held: bool,
    at: Pos2,
    last_frame: Option<Monotonic>,
    frames: Vec<Vec<Duration>>,
    works: Vec<Vec<Duration>>,
    commands: Vec<Look>,
    seconds: Vec<(Duration, Duration)>,
    began: (Monotonic, Duration),
}

impl Steps {
    pub(crate) fn current(&self) -> Option<Step> {
        ORDER.get(self.step).map(|(step, _)| *step)
    }

    pub(crate) const fn index(&self) -> usize {
        self.index
    }

    pub(crate) const fn is_over(&self) -> bool {
        self.step >= ORDER.len()
    }

    pub(crate) fn take_command(&mut self) -> Option<Look> {
        self.commands.pop()
    }

    /// Counts the frame that is over, and says what the hand does in the next.
    pub(crate) fn next_frame(&mut self, view: &MapView, events: &mut Vec<Event>) {
        let now = clock::now();
        let Some(step) = self.current() else { return };
        if self.frames.len() <= self.step {
            self.frames.push(Vec::new());
            self.works.push(Vec::new());
            self.began = (now, process_cpu());
            self.begin(step, view);
        } else if let Some(last) = self.last_frame {
            self.frames[self.step].push(now.since(last));
        }
        self.last_frame = Some(now);
        // A real pointer elsewhere must not interfere.
        events.retain(|event| !matches!(event, Event::PointerMoved(_) | Event::PointerGone));
        match step {
            Step::PanWhole | Step::PanMiddle | Step::PanClose | Step::PanTurned => {
                self.drag(events);
            }
            Step::Zoom => {
                let is_in = self.index % 100 < 50;
                events.push(Event::PointerMoved(HOLD));
                events.push(Event::MouseWheel {
                    unit: MouseWheelUnit::Line,
                    delta: vec2(0.0, if is_in { 1.0 } else { -1.0 }),
                    phase: TouchPhase::Move,
                    source: MouseWheelSource::Wheel,
                    modifiers: Modifiers::NONE,
                });
            }
            Step::Rest | Step::Still | Step::Update => {}
        }
        self.index += 1;
        if self.index >= FRAMES {
            let (since, cpu) = self.began;
            self.seconds
                .push((now.since(since), process_cpu().saturating_sub(cpu)));
            self.release(events);
            self.index = 0;
            self.step += 1;
        }
    }

    /// So long the main thread took for the map view and its panel in this frame.
    pub(crate) fn worked(&mut self, time: Duration) {
        if let Some(works) = self.works.last_mut() {
            works.push(time);
        }
    }

    fn begin(&mut self, step: Step, view: &MapView) {
        let [low_x, _, high_x, _] = view.visible_m();
        let points_per_cell = 0.1 * 990.0 / (high_x - low_x);
        // As many steps of 1.4 as it takes: done in one frame, which is not counted.
        let mut zoom = |points: f64| {
            let steps = libm::log(points / points_per_cell) / libm::log(1.4);
            let look = if steps > 0.0 { Look::In } else { Look::Out };
            for _ in 0..steps.abs().round() as usize {
                self.commands.push(look);
            }
        };
        match step {
            Step::PanMiddle => zoom(0.25),
            Step::PanClose => zoom(1.0),
            Step::PanTurned => self.commands.push(Look::Up(Orientation::RobotUp)),
            Step::Zoom => {
                self.commands.push(Look::Up(Orientation::NorthUp));
                self.commands.push(Look::Whole);
            }
            Step::Still => {
                zoom(1.0);
                self.commands.push(Look::Follow(true));
            }
            Step::Rest | Step::PanWhole | Step::Update => {}
        }
    }

    /// Pulls the map to and fro, letting go and taking hold again at the edge of the screen.
    fn drag(&mut self, events: &mut Vec<Event>) {
        if !self.is_held {
            self.at = HOLD;
            self.is_held = true;
            events.push(Event::PointerMoved(self.at));
            events.push(button(self.at, true));
            return;
        }
        let towards = if self.index % 120 < 60 { -1.0 } else { 1.0 };
        self.at += vec2(towards * DRAG, 0.4 * towards * DRAG);
        events.push(Event::PointerMoved(self.at));
        if !(320.0..1240.0).contains(&self.at.x) || !(20.0..780.0).contains(&self.at.y) {
            self.release(events);
        }
    }

    fn release(&mut self, events: &mut Vec<Event>) {
        if std::mem::take(&mut self.is_held) {
            events.push(button(self.at, false));
        }
    }

    pub(crate) fn report(&self) {
        println!(
            "| step | frames | p50 ms | p99 ms | max ms | map view p50 ms | p99 ms | CPU of all threads |"
        );
        println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
        for (index, (_, name)) in ORDER.iter().enumerate().take(self.seconds.len()) {
            let mut frames = self.frames[index].clone();
            let mut works = self.works[index].clone();
            frames.sort_unstable();
            works.sort_unstable();
            let ms = |times: &[Duration], part: f64| {
                let at = ((times.len() - 1) as f64 * part).round() as usize;
                times[at].as_secs_f64() * 1e3
            };
            let (wall, cpu) = self.seconds[index];
            println!(
                "| {name} | {} | {:.1} | {:.1} | {:.1} | {:.2} | {:.2} | {:.0} % |",
                frames.len(),
                ms(&frames, 0.5),
                ms(&frames, 0.99),
                ms(&frames, 1.0),
                ms(&works, 0.5),
                ms(&works, 0.99),
                100.0 * cpu.as_secs_f64() / wall.as_secs_f64()
            );
        }
    }
}

const fn button(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    }
}

/// What all threads have run so far, in hundredths of a second.
fn process_cpu() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks = fields.split_whitespace().skip(11).take(2);
    let ticks: u64 = ticks.filter_map(|ticks| ticks.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * ticks)
}

/// A line of `/proc/self/status`.
pub(crate) fn memory_mib(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(name));
    let kib = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok());
    kib.unwrap_or(0) / 1024
}
