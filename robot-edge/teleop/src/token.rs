//! Tokens: how the vehicle knows the age of a command without trusting any clock but its own.
//!
//! A command carries the newest token that its console received. The time since this token was issued is an upper bound
//! of the command's age.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::Refusal;

const TOKEN_LIFETIME: Duration = Duration::from_secs(2);

/// Tokens remembered: `TOKEN_LIFETIME` at 50 Hz, and as much again as rounds that come early may add. Where more are
/// issued the oldest are forgotten sooner, which refuses commands and never accepts one.
const CAPACITY: usize = 128;

/// What a console sends back to show how fresh its command is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AgeToken {
    /// 128 random bits of this run of the vehicle's process.
    pub boot_id: u128,
    /// Counts tokens.
    pub n: u64,
    /// 64 random bits, so that a token cannot be guessed before it is issued.
    pub nonce: u64,
}

/// The tokens of the last `TOKEN_LIFETIME`, and when each was issued.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TokenRing {
    pub(super) boot_id: u128,
    pub(super) next_n: u64,
    pub(super) slots: [Slot; CAPACITY],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) struct Slot {
    pub(super) nonce: u64,
    pub(super) issued: Monotonic,
}

impl TokenRing {
    /// No token yet. `boot_id` must be random: it is what makes commands of an earlier run worthless.
    pub const fn new(boot_id: u128) -> Self {
        let slot = Slot {
            nonce: 0,
            issued: Monotonic::from_nanos(0),
        };
        Self {
            boot_id,
            next_n: 0,
            slots: [slot; CAPACITY],
        }
    }

    /// A new token. `nonce` must be random.
    pub fn issue(&mut self, now: Monotonic, nonce: u64) -> AgeToken {
        let n = self.next_n;
        self.next_n += 1;
        self.slots[slot_of(n)] = Slot { nonce, issued: now };
        AgeToken {
            boot_id: self.boot_id,
            n,
            nonce,
        }
    }

    /// The newest token.
    pub fn newest(&self) -> Option<AgeToken> {
        let n = self.next_n.checked_sub(1)?;
        Some(AgeToken {
            boot_id: self.boot_id,
            n,
            nonce: self.slots[slot_of(n)].nonce,
        })
    }

    /// When `token` was issued.
    pub fn issued(&self, token: AgeToken, now: Monotonic) -> Result<Monotonic, Refusal> {
        if token.boot_id != self.boot_id {
            return Err(Refusal::OtherBoot);
        }
        // 1 for the newest token.
        let back = self.next_n.saturating_sub(token.n);
        if !(1..=CAPACITY as u64).contains(&back) {
            return Err(Refusal::UnknownToken);
        }
        let slot = self.slots[slot_of(token.n)];
        if token.nonce != slot.nonce {
            return Err(Refusal::WrongNonce);
        }
        // The arbiter decides by the age; this only bounds how long a token is known.
        if now.since(slot.issued) > TOKEN_LIFETIME {
            return Err(Refusal::TooOld);
        }
        Ok(slot.issued)
    }

    /// The time since `token` was issued.
    pub fn age(&self, token: AgeToken, now: Monotonic) -> Result<Duration, Refusal> {
        Ok(now.since(self.issued(token, now)?))
    }
}

const fn slot_of(n: u64) -> usize {
    (n % CAPACITY as u64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOOT: u128 = 0xfeed_beef;

    fn at(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn a_token_tells_the_time_since_its_issue() {
        let mut ring = TokenRing::new(BOOT);
        let first = ring.issue(at(1000), 7);
        let second = ring.issue(at(1020), 8);
        assert_eq!(ring.age(first, at(1030)), Ok(Duration::from_millis(30)));
        assert_eq!(ring.age(second, at(1030)), Ok(Duration::from_millis(10)));
        assert_eq!(ring.age(second, at(1020)), Ok(Duration::ZERO));
        assert_eq!(ring.issued(first, at(1030)), Ok(at(1000)));
    }

    #[test]
    fn what_was_not_issued_is_refused() {
        let mut ring = TokenRing::new(BOOT);
        let unborn = AgeToken {
            boot_id: BOOT,
            n: 0,
            nonce: 0,
        };
        assert_eq!(ring.age(unborn, at(0)), Err(Refusal::UnknownToken));
        let token = ring.issue(at(1000), 7);
        let now = at(1001);
        for (token, fault) in [
            (
                AgeToken {
                    boot_id: 1,
                    ..token
                },
                Refusal::OtherBoot,
            ),
            (AgeToken { nonce: 8, ..token }, Refusal::WrongNonce),
            (AgeToken { n: 1, ..token }, Refusal::UnknownToken),
            (
                AgeToken {
                    n: u64::MAX,
                    ..token
                },
                Refusal::UnknownToken,
            ),
            (
                AgeToken {
                    n: CAPACITY as u64,
                    ..token
                },
                Refusal::UnknownToken,
            ),
        ] {
            assert_eq!(ring.age(token, now), Err(fault), "{token:?}");
        }
    }

    #[test]
    fn tokens_expire_and_are_forgotten() {
        let mut ring = TokenRing::new(BOOT);
        let first = ring.issue(at(0), 1);
        assert_eq!(ring.age(first, at(2000)), Ok(TOKEN_LIFETIME));
        assert_eq!(ring.age(first, at(2001)), Err(Refusal::TooOld));
        // Two seconds at 50 Hz fit, whatever the rounds' jitter.
        for n in 1..=100 {
            ring.issue(at(n * 20), n);
        }
        assert_eq!(ring.age(first, at(2000)), Ok(TOKEN_LIFETIME));
        for n in 0..28 {
            ring.issue(at(2000), n);
        }
        assert_eq!(ring.age(first, at(2000)), Err(Refusal::UnknownToken));
    }
}
