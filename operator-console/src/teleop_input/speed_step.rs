//! How fast a key drives.

/// A share of the vehicle's greatest speed and turn rate, in five steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SpeedStep(u8);

impl SpeedStep {
    /// How many there are.
    pub const COUNT: u8 = 5;

    /// The step of a number key, 1 to [`SpeedStep::COUNT`].
    pub const fn new(number: u8) -> Option<Self> {
        match number {
            1..=Self::COUNT => Some(Self(number)),
            _ => None,
        }
    }

    /// Every step, slowest first.
    pub fn all() -> impl Iterator<Item = Self> {
        (1..=Self::COUNT).map(Self)
    }

    /// Its number key.
    pub const fn number(self) -> u8 {
        self.0
    }

    /// The share of the greatest speed, above 0 and at most 1.
    pub fn share(self) -> f32 {
        f32::from(self.0) / f32::from(Self::COUNT)
    }

    /// The next faster one, or the fastest.
    #[must_use]
    pub const fn faster(self) -> Self {
        match Self::new(self.0 + 1) {
            Some(step) => step,
            None => self,
        }
    }

    /// The next slower one, or the slowest.
    #[must_use]
    pub const fn slower(self) -> Self {
        match Self::new(self.0 - 1) {
            Some(step) => step,
            None => self,
        }
    }
}

impl Default for SpeedStep {
    /// Slow, but for the slowest.
    fn default() -> Self {
        Self(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_five_shares_of_the_greatest_speed() {
        let shares: Vec<_> = SpeedStep::all().map(SpeedStep::share).collect();
        assert_eq!(shares, [0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(SpeedStep::new(0), None);
        assert_eq!(SpeedStep::new(6), None);
        let (slowest, fastest) = (SpeedStep::new(1).unwrap(), SpeedStep::new(5).unwrap());
        assert_eq!((slowest.slower(), fastest.faster()), (slowest, fastest));
        assert_eq!(SpeedStep::default().faster().number(), 3);
        assert_eq!(SpeedStep::default().slower().number(), 1);
    }
}
