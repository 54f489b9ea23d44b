//! What an operator's console asks of the vehicle, 50 times a second.

use super::operator::OperatorId;
use super::token::AgeToken;
use super::velocity::Velocity;

/// One iteration of a console's input loop, as the vehicle knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveCommand {
    /// Who sent it, as its signature proves.
    pub operator: OperatorId,
    /// The grant of the lease that it relies on.
    pub epoch: u64,
    /// Grows with every command of an epoch.
    pub seq: u64,
    /// The newest token that the console had when it read its keys.
    pub token: AgeToken,
    /// What is pressed; [`Velocity::ZERO`] where nothing is.
    pub requested: Velocity,
    /// Stop at once and stay stopped. Obeyed whatever epoch, sequence number and token are.
    pub estop: bool,
}
