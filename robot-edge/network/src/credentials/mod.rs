//! Identities on the network: a certificate authority, certificates for each role, signing keys and operator lists.
//!
//! `robot-edge keys` makes them ([`issue()`]), `robot-edge install-keys` puts a vehicle's in their place
//! ([`install()`]), `--keys` reads a folder of them ([`Credentials`]). Certificates decide who may connect and what
//! access control permits ([`crate::security`]); signing keys prove who commands a vehicle, independent of
//! routers in between ([`protocol::signed`]). The list beside a vehicle's certificate has the last word.

mod authority;
mod files;
mod install;
pub mod issue;
pub mod operator_list;

pub use authority::Certificate;
pub use files::{CredentialsError, FleetFolder};
pub use install::{Credentials, Installed, install};
pub use issue::{IssueRequest, issue};
pub use operator_list::{Identity, ListedOperator, OperatorList};
