//! The seeds of an experiment, its progress, and its interruption.

use std::ops::RangeInclusive;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;

use edge::exit::Interrupted;

/// By which preset maps are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rules {
    /// The vehicle's own.
    Own,
    /// That with the rules of its document, `NAME-document`.
    Document,
}

/// What all experiments of one call share.
pub struct Session<'a> {
    rules: Rules,
    seeds: u64,
    interrupt: &'a AtomicBool,
    progress: &'a (dyn Fn(&str) + Sync),
}

/// The seed of everything that is shown for one seed only.
pub const SEED: u64 = 1;

impl<'a> Session<'a> {
    /// Seeds 1 to `seeds` (at least 1). `progress` receives each step, from any thread; setting `interrupt` ends the
    /// experiment before its next run.
    pub fn new(seeds: u64, interrupt: &'a AtomicBool, progress: &'a (dyn Fn(&str) + Sync)) -> Self {
        Self {
            rules: Rules::Own,
            seeds: seeds.max(1),
            interrupt,
            progress,
        }
    }

    /// The same by the rules of the documents.
    #[must_use]
    pub fn by_document(&self) -> Self {
        Self {
            rules: Rules::Document,
            ..*self
        }
    }

    pub(super) fn rules(&self) -> Rules {
        self.rules
    }

    pub fn seeds(&self) -> RangeInclusive<u64> {
        SEED..=self.seeds
    }

    /// "seed 1" or "seeds 1 to 20".
    pub fn seeds_text(&self) -> String {
        match self.seeds {
            SEED => "seed 1".to_owned(),
            last => format!("seeds {SEED} to {last}"),
        }
    }

    /// Reports a step; an error once the experiment is interrupted.
    pub fn step(&self, what: &str) -> Result<(), Interrupted> {
        if self.interrupt.load(Ordering::Relaxed) {
            return Err(Interrupted);
        }
        (self.progress)(what);
        Ok(())
    }

    /// Runs `each` for every seed, on all processors; returns the results in the order of the seeds, or the first error.
    pub fn for_each_seed<T: Send>(
        &self,
        what: &str,
        each: impl Fn(u64) -> anyhow::Result<T> + Sync,
    ) -> anyhow::Result<Vec<T>> {
        let workers = thread::available_parallelism()
            .map_or(1, |processors| processors.get() as u64)
            .min(self.seeds);
        let next = AtomicU64::new(SEED);
        let results = Mutex::new(Vec::new());
        thread::scope(|scope| {
            for _ in 0..workers {
                scope.spawn(|| {
                    loop {
                        let seed = next.fetch_add(1, Ordering::Relaxed);
                        if seed > self.seeds {
                            return;
                        }
                        let result = self
                            .step(&format!("{what}, seed {seed} of {}", self.seeds))
                            .map_err(anyhow::Error::from)
                            .and_then(|()| each(seed));
                        if result.is_err() {
                            next.store(self.seeds + 1, Ordering::Relaxed);
                        }
                        let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
                        results.push((seed, result));
                    }
                });
            }
        });
        let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
        results.sort_by_key(|(seed, _)| *seed);
        results.into_iter().map(|(_, result)| result).collect()
    }
}

#[cfg(test)]
mod tests {
    use anyhow::bail;

    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_seeds_and_an_interrupt_ends_it() {
        let (go, stop) = (AtomicBool::new(false), AtomicBool::new(true));
        let session = Session::new(7, &go, &|_| ());
        let squares = session.for_each_seed("squares", |seed| Ok(seed * seed));
        assert_eq!(squares.unwrap(), [1, 4, 9, 16, 25, 36, 49]);
        let failed = session.for_each_seed("fails", |seed| match seed {
            3 => bail!("three"),
            seed => Ok(seed),
        });
        assert_eq!(failed.unwrap_err().to_string(), "three");
        let stopped = Session::new(7, &stop, &|_| ()).for_each_seed("none", Ok);
        assert!(stopped.unwrap_err().is::<Interrupted>());
    }
}
