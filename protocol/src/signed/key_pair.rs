//! Keys of operators, as files that `openssl` reads and writes: PKCS#8 and SPKI in PEM (RFC 8410).

use std::fmt;

use ed25519_dalek::pkcs8::spki::der::pem::LineEnding;
use ed25519_dalek::pkcs8::{
    DecodePrivateKey, DecodePublicKey, EncodePrivateKey, EncodePublicKey, KeypairBytes,
};
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use zeroize::Zeroizing;

use crate::keys::OperatorId;

/// Bytes of a signature.
pub const SIGNATURE_BYTES: usize = ed25519_dalek::SIGNATURE_LENGTH;

/// What an operator signs with. Wiped from memory when dropped, and never printed.
#[derive(Clone)]
pub struct SecretKey(SigningKey);

/// What a robot tells an operator by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PublicKey(VerifyingKey);

/// A text that is no key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InvalidKey {
    /// Not a secret key at all, or one for something else.
    #[error(
        "it is no secret Ed25519 key in PEM (`-----BEGIN PRIVATE KEY-----`): `openssl genpkey -algorithm ed25519` \
         makes one"
    )]
    Secret,
    /// Not a public key at all, or one for something else.
    #[error(
        "it is no public Ed25519 key in PEM (`-----BEGIN PUBLIC KEY-----`): `openssl pkey -pubout` makes one of the \
         secret key"
    )]
    Public,
    /// A point of small order, for which anybody can sign.
    #[error("it is a weak public key, for which anybody could sign")]
    Weak,
    /// The key cannot be written.
    #[error("the key cannot be encoded")]
    Encoding,
}

impl SecretKey {
    /// The key of 32 bytes, which must come from the system's random numbers.
    pub fn from_seed(seed: &[u8; 32]) -> Self {
        Self(SigningKey::from_bytes(seed))
    }

    /// What an operator signs with on a link without keys. Everybody can make it: such a signature proves nothing, and
    /// saves a second way of reading commands.
    pub fn without_secret(operator: &OperatorId) -> Self {
        let seed = blake3::derive_key(
            "foreshore operator without keys",
            operator.as_str().as_bytes(),
        );
        Self::from_seed(&seed)
    }

    /// The key in a PEM text: PKCS#8, with or without the public key in it.
    ///
    /// # Errors
    /// Where it is none.
    pub fn from_pem(pem: &str) -> Result<Self, InvalidKey> {
        SigningKey::from_pkcs8_pem(pem)
            .map(Self)
            .map_err(|_why| InvalidKey::Secret)
    }

    /// The key as a PEM text, which is to be readable by its owner alone.
    ///
    /// PKCS#8 in version 1, without the public key in it: `openssl` does not read version 2.
    ///
    /// # Errors
    /// None that is known.
    pub fn to_pem(&self) -> Result<Zeroizing<String>, InvalidKey> {
        let pair = KeypairBytes {
            secret_key: self.0.to_bytes(),
            public_key: None,
        };
        pair.to_pkcs8_pem(LineEnding::LF)
            .map_err(|_why| InvalidKey::Encoding)
    }

    /// What others tell it by.
    pub fn public(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }

    pub(super) fn sign(&self, input: &[u8]) -> [u8; SIGNATURE_BYTES] {
        self.0.sign(input).to_bytes()
    }
}

impl fmt::Debug for SecretKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SecretKey").finish_non_exhaustive()
    }
}

impl PublicKey {
    /// The key in a PEM text.
    ///
    /// # Errors
    /// Where it is none, or a weak one.
    pub fn from_pem(pem: &str) -> Result<Self, InvalidKey> {
        let key = VerifyingKey::from_public_key_pem(pem).map_err(|_why| InvalidKey::Public)?;
        if key.is_weak() {
            Err(InvalidKey::Weak)
        } else {
            Ok(Self(key))
        }
    }

    /// The key as a PEM text.
    ///
    /// # Errors
    /// None that is known.
    pub fn to_pem(&self) -> Result<String, InvalidKey> {
        self.0
            .to_public_key_pem(LineEnding::LF)
            .map_err(|_why| InvalidKey::Encoding)
    }

    /// By the strict rules, by which a message has one signature of a key and no other.
    pub(super) fn verify(&self, input: &[u8], signature: &[u8; SIGNATURE_BYTES]) -> bool {
        let signature = Signature::from_bytes(signature);
        self.0.verify_strict(input, &signature).is_ok()
    }
}
