//! The token of the TCP listener: read from a file that only its owner (and a group) may read, compared in constant
//! time. Read once by the main thread; compared by the thread that serves connections.

use std::fmt;
use std::hint::black_box;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Minimum length of a token, characters: 128 bits in hexadecimal digits.
pub const TOKEN_LENGTH_MIN: usize = 32;
/// Maximum length of a token, characters.
pub const TOKEN_LENGTH_MAX: usize = 256;

/// The secret that clients on TCP must present.
pub struct Token(Vec<u8>);

impl fmt::Debug for Token {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Token(…)")
    }
}

/// The reason why a token cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error("token file {path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Everybody may read the file, or others may write it.
    #[error(
        "token file {path} has mode {mode:04o}, so others can read or change the token: `chmod 600 {path}`, then create a new token"
    )]
    NotPrivate {
        /// The file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// The file belongs neither to our user nor to root.
    #[error(
        "token file {path} belongs to user {owner}: `chown` it to the user that runs the cell, or to root"
    )]
    WrongOwner {
        /// The file.
        path: PathBuf,
        /// Its owner's user id.
        owner: u32,
    },
    /// The token is too short, too long, or has other characters.
    #[error(
        "token file {path} must contain a token of {TOKEN_LENGTH_MIN} to {TOKEN_LENGTH_MAX} letters and digits: create one with `openssl rand -hex 32 > {path}`"
    )]
    Weak {
        /// The file.
        path: PathBuf,
    },
}

impl Token {
    /// Reads the token; surrounding white space is ignored.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, if others may read or write it, or if its token could be guessed.
    pub fn read(path: &Path) -> Result<Token, TokenError> {
        let failed = |source| TokenError::File {
            path: path.to_owned(),
            source,
        };
        let file = rcc_os::file::open(path).map_err(failed)?;
        let found = file.metadata().map_err(failed)?;
        let owner = found.uid();
        if owner != 0 && owner != nix::unistd::geteuid().as_raw() {
            return Err(TokenError::WrongOwner {
                path: path.to_owned(),
                owner,
            });
        }
        if found.mode() & 0o027 != 0 {
            return Err(TokenError::NotPrivate {
                path: path.to_owned(),
                mode: found.mode() & 0o7777,
            });
        }
        let mut text = Vec::new();
        let most = 2 * TOKEN_LENGTH_MAX as u64;
        file.take(most).read_to_end(&mut text).map_err(failed)?;
        let token = text.trim_ascii();
        let length = TOKEN_LENGTH_MIN..=TOKEN_LENGTH_MAX;
        let plain = token.iter().all(u8::is_ascii_graphic);
        // A single repeated character is as weak as one character.
        let varied = token.iter().any(|byte| Some(byte) != token.first());
        if length.contains(&token.len()) && plain && varied {
            Ok(Token(token.to_vec()))
        } else {
            Err(TokenError::Weak {
                path: path.to_owned(),
            })
        }
    }

    /// Makes a token of 256 random bits.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn random() -> io::Result<Token> {
        let mut bits = [0; 32];
        io::Read::read_exact(&mut std::fs::File::open("/dev/urandom")?, &mut bits)?;
        let digits: String = bits.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Token(digits.into_bytes()))
    }

    /// Returns the token as text, to be given to a client.
    #[must_use]
    pub fn reveal(&self) -> String {
        String::from_utf8_lossy(&self.0).into_owned()
    }

    /// Returns the value of the header `authorization`.
    #[must_use]
    pub fn bearer(&self) -> Vec<u8> {
        [b"Bearer ", self.0.as_slice()].concat()
    }

    /// Returns true if `given` is this token, in a time that does not depend on where they first differ.
    #[must_use]
    pub fn is(&self, given: &[u8]) -> bool {
        let same_length = self.0.len() == given.len();
        let given = given.iter().chain(std::iter::repeat(&0));
        let difference = self
            .0
            .iter()
            .zip(given)
            .fold(0, |all, (one, other)| black_box(all | (one ^ other)));
        same_length & (difference == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use rcc_testing::TempDir;

    const GOOD: &str = "0123456789abcdef0123456789abcdef";

    /// Returns the path of a file with this text and mode, and its folder.
    fn file(text: &str, mode: u32) -> io::Result<(PathBuf, TempDir)> {
        let folder = rcc_testing::folder();
        let path = folder.path().join("token");
        fs::write(&path, text)?;
        fs::set_permissions(&path, fs::Permissions::from_mode(mode))?;
        Ok((path, folder))
    }

    #[test]
    fn only_the_whole_token_is_the_token() -> Result<(), Box<dyn std::error::Error>> {
        let (file, _folder) = file(&format!("{GOOD}\n"), 0o640)?;
        let token = Token::read(&file)?;
        assert!(token.is(GOOD.as_bytes()));
        for wrong in [
            "",
            "0",
            &GOOD[1..],
            &format!("{GOOD}0"),
            &format!("{GOOD}\0"),
            &GOOD.replace('f', "e"),
        ] {
            assert!(!token.is(wrong.as_bytes()), "{wrong}");
        }
        assert_eq!(format!("{token:?}"), "Token(…)");
        Ok(())
    }

    #[test]
    fn a_random_token_is_long_and_never_the_same() -> io::Result<()> {
        let (one, other) = (Token::random()?, Token::random()?);
        assert_eq!(one.reveal().len(), 64);
        assert!(one.is(one.reveal().as_bytes()) && !one.is(other.reveal().as_bytes()));
        Ok(())
    }

    #[test]
    fn a_file_that_others_may_read_or_write_is_refused() -> io::Result<()> {
        for mode in [0o644, 0o604, 0o660, 0o602] {
            let (file, _folder) = file(GOOD, mode)?;
            let refused = Token::read(&file);
            assert!(
                matches!(refused, Err(TokenError::NotPrivate { .. })),
                "{mode:o}: {refused:?}"
            );
        }
        Ok(())
    }

    #[test]
    fn a_weak_token_is_refused_with_a_remedy() -> io::Result<()> {
        for text in [
            "",
            "\n",
            "secret",
            &GOOD[1..],
            &"a".repeat(32),
            &"ab ".repeat(20),
            &GOOD.repeat(9),
        ] {
            let (file, _folder) = file(text, 0o600)?;
            match Token::read(&file) {
                Err(error @ TokenError::Weak { .. }) => {
                    assert!(error.to_string().contains("openssl rand"))
                }
                other => panic!("{text}: {other:?}"),
            }
        }
        let missing = Token::read(Path::new("/nonexistent/token"));
        assert!(matches!(missing, Err(TokenError::File { .. })));
        let folder = Token::read(&std::env::temp_dir());
        assert!(matches!(folder, Err(TokenError::File { .. })));
        Ok(())
    }
}
