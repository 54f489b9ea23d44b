//! Who is who on the network: a certificate authority, certificates for each role, signing keys and lists of operators.
//!
//! `robot-edge keys` makes them ([`issue()`]), `robot-edge install-keys` puts a vehicle's in their place ([`install()`]), `--keys`
//! reads a folder of them ([`Credentials`]). Certificates say who may
//! connect and what access control lets through ([`crate::link::security`]); signing keys say who wants a vehicle to move,
//! whatever routers are in between ([`protocol::signed`]). The list beside a vehicle's certificate has the last word.

mod authority;
mod certificate;
mod error;
mod files;
mod folder;
mod identity;
mod install;
pub mod issue;
pub mod operator_list;
mod own_credentials;

pub use certificate::Certificate;
pub use error::CredentialsError;
pub use folder::FleetFolder;
pub use identity::Identity;
pub use install::{Installed, install};
pub use issue::{IssueRequest, issue};
pub use operator_list::{ListedOperator, OperatorList};
pub use own_credentials::Credentials;
