//! The same work several times over, and what its times say.

use std::fmt;
use std::fs;
use std::hint::black_box;

use network::clock;

/// How often everything is measured.
pub(crate) const ROUNDS: usize = 5;

/// One figure of every round, sorted.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rounds(Vec<f64>);

impl Rounds {
    /// Adds the figure of one round.
    pub(crate) fn add(&mut self, figure: f64) {
        let at = self.0.partition_point(|other| *other < figure);
        self.0.insert(at, figure);
    }

    /// The middle one, or the lower of two; NaN where there is none.
    pub(crate) fn median(&self) -> f64 {
        self.quantile(0.5)
    }

    /// The figure that `q` of the others do not exceed.
    pub(crate) fn quantile(&self, q: f64) -> f64 {
        let last = self.0.len().saturating_sub(1);
        let at = (q * last as f64) as usize;
        self.0.get(at).copied().unwrap_or(f64::NAN)
    }

    /// All figures turned into another unit.
    pub(crate) fn map(&self, unit: impl Fn(f64) -> f64) -> Self {
        self.0.iter().copied().map(unit).collect()
    }
}

impl fmt::Display for Rounds {
    /// Median and spread, with the precision asked for.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = f.precision().unwrap_or(2);
        write!(
            f,
            "{:.digits$} ({:.digits$} … {:.digits$})",
            self.median(),
            self.quantile(0.0),
            self.quantile(1.0),
        )
    }
}

impl FromIterator<f64> for Rounds {
    fn from_iter<I: IntoIterator<Item = f64>>(figures: I) -> Self {
        let mut figures: Vec<f64> = figures.into_iter().collect();
        figures.sort_unstable_by(f64::total_cmp);
        Self(figures)
    }
}

/// What `work` returns, and the processor time it took, seconds: on a machine that others use too, the time
/// that passes says more of them.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let started_s = processor_s();
    let result = black_box(work());
    (result, processor_s() - started_s)
}

/// What `work` returns, and the time that passed, seconds.
pub(crate) fn timed_by_the_wall<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let started = clock::now();
    let result = black_box(work());
    (result, clock::elapsed(started).as_secs_f64())
}

/// Processor time of the processes that this one started and waited for, seconds, to the hundredth; NaN
/// where the system does not tell.
pub(crate) fn children_processor_s() -> f64 {
    // proc(5): fields 16 and 17, in ticks of 1/100 s; the second is a name that may hold blanks.
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let fields: Vec<f64> = after_name
        .split_ascii_whitespace()
        .skip(13)
        .take(2)
        .filter_map(|ticks| ticks.parse().ok())
        .collect();
    match fields[..] {
        [user, system] => (user + system) / 100.0,
        _ => f64::NAN,
    }
}

#[cfg(target_os = "linux")]
fn processor_s() -> f64 {
    let used = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    used.tv_sec as f64 + used.tv_nsec as f64 / 1e9
}

#[cfg(not(target_os = "linux"))]
fn processor_s() -> f64 {
    clock::now().since(Monotonic::default()).as_secs_f64()
}
