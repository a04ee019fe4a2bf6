//! Client of the loader's REST interface for the verbs: the requests of `rcc-client`, whose errors become failures. Each
//! request blocks the calling thread for at most its time-out.

use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

use rcc_api::bodies::{CommandView, ValuesView};
use rcc_client::RequestError;
use serde::de::DeserializeOwned;

use crate::failure::Failure;

pub use rcc_client::{RemoteLoader, segment};

impl From<RequestError> for Failure {
    fn from(error: RequestError) -> Failure {
        Failure {
            exit: error.exit,
            body: error.body,
            source: None,
        }
    }
}

/// REST client of one cell's loader.
#[derive(Debug)]
pub struct LoaderClient(rcc_client::LoaderClient);

impl LoaderClient {
    /// Creates a client of the cell `cell` that uses the Unix socket `socket`; each request takes at most `timeout`.
    ///
    /// # Errors
    /// Fails if the system cannot create an event queue.
    pub fn new(cell: &str, socket: &Path, timeout: Duration) -> Result<LoaderClient, Failure> {
        let client = rcc_client::LoaderClient::new(cell, socket, timeout)?;
        Ok(LoaderClient(client))
    }

    /// Creates a client that reaches the loader over TCP.
    ///
    /// # Errors
    /// As [`LoaderClient::new`].
    pub fn remote(remote: RemoteLoader, timeout: Duration) -> Result<LoaderClient, Failure> {
        let client = rcc_client::LoaderClient::remote(remote, timeout)?;
        Ok(LoaderClient(client))
    }

    /// Sends a GET request.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached, does not answer in time, or refuses the request.
    pub fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, Failure> {
        Ok(self.0.get(path)?)
    }

    /// LOAD: as [`rcc_client::LoaderClient::load`].
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn load(&self, file: &str, text: &str, limit: Duration) -> Result<CommandView, Failure> {
        Ok(self.0.load(Some(file), text, limit)?)
    }

    /// Sends a POST request with a text body.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn post<T: DeserializeOwned>(&self, path: &str, body: String) -> Result<T, Failure> {
        Ok(self.0.post(path, body)?)
    }

    /// Sends a PUT request with a text body.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn put<T: DeserializeOwned>(&self, path: &str, body: String) -> Result<T, Failure> {
        Ok(self.0.put(path, body)?)
    }

    /// Sends a DELETE request.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn delete<T: DeserializeOwned>(&self, path: &str) -> Result<T, Failure> {
        Ok(self.0.delete(path)?)
    }

    /// Returns the values of the ports that match the patterns, all of one cycle; without patterns, the values of all
    /// outputs.
    ///
    /// # Errors
    /// As [`LoaderClient::get`].
    pub fn values(&self, net: &str, ports: &[String]) -> Result<ValuesView, Failure> {
        Ok(self.0.values(net, ports)?)
    }

    /// Downloads the file at `path` into `out`, and returns its length in bytes.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached or refuses the request, or if `write_failed` describes why `out` cannot be
    /// written.
    pub fn download(
        &self,
        path: &str,
        out: &mut impl Write,
        write_failed: impl Fn(&io::Error) -> Failure,
    ) -> Result<u64, Failure> {
        let write_failed = |error: &io::Error| {
            let Failure { exit, body, .. } = write_failed(error);
            RequestError { exit, body }
        };
        Ok(self.0.download(path, out, write_failed)?)
    }
}

/// Returns the failure for a cell whose loader cannot be reached.
#[must_use]
pub fn no_loader(cell: &str, cause: &str) -> Failure {
    rcc_client::no_loader(cell, cause).into()
}

#[cfg(test)]
mod tests {
    /// `rcc-client`, which does not depend on shared memory, finds cells where all other programs do.
    #[test]
    fn the_client_looks_for_cells_where_they_are() {
        assert_eq!(rcc_client::runtime_folder(), rcc_ipc::cell::base_dir());
    }
}
