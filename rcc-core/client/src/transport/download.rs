//! Downloads a long file from the loader, piece by piece; an interrupted download goes on where it was interrupted.
//! Blocks the calling thread for as long as data arrives.

use std::io::{self, Write};

use http_body_util::{BodyExt, Full};
use hyper::Request;
use rcc_api::codes;

use super::stream::{in_time, refusal};
use super::{LoaderClient, timeout_help};
use crate::error::RequestError;

/// Reason why a download ended early.
enum DownloadError {
    /// The connection failed, or no data arrived in time.
    Interrupted(io::Error),
    /// The loader refused it, or the file cannot be written.
    Failed(RequestError),
}

impl From<io::Error> for DownloadError {
    fn from(error: io::Error) -> DownloadError {
        DownloadError::Interrupted(error)
    }
}

impl From<hyper::Error> for DownloadError {
    fn from(error: hyper::Error) -> DownloadError {
        DownloadError::Interrupted(io::Error::other(error))
    }
}

impl LoaderClient {
    /// Downloads the file at `path` into `out`, and returns its length in bytes. Goes on after an interruption as long as
    /// each connection brings data; each piece arrives within the client's time-out.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached or refuses the request, or if `write_failed` describes why `out` cannot be
    /// written.
    pub fn download(
        &self,
        path: &str,
        out: &mut impl Write,
        write_failed: impl Fn(&io::Error) -> RequestError,
    ) -> Result<u64, RequestError> {
        let mut received = 0;
        loop {
            let before = received;
            let part = self.receive(path, &mut received, out, &write_failed);
            match self.runtime.block_on(part) {
                Ok(()) => return Ok(received),
                Err(DownloadError::Failed(failure)) => return Err(failure),
                Err(DownloadError::Interrupted(_)) if received > before => {}
                Err(DownloadError::Interrupted(error))
                    if error.kind() == io::ErrorKind::TimedOut =>
                {
                    let message =
                        format!("the download of {path} stopped after {received} bytes: {error}");
                    return Err(RequestError::new(
                        codes::LOADER_SILENT,
                        message,
                        timeout_help(path),
                    ));
                }
                Err(DownloadError::Interrupted(error)) => return Err(self.unreachable(&error)),
            }
        }
    }

    /// Receives the rest of the file over one connection.
    async fn receive(
        &self,
        path: &str,
        received: &mut u64,
        out: &mut impl Write,
        write_failed: &impl Fn(&io::Error) -> RequestError,
    ) -> Result<(), DownloadError> {
        let mut connection = in_time(self.timeout, self.connect()).await??;
        let mut request = self.authorized(Request::get(path));
        if *received > 0 {
            request = request.header("range", format!("bytes={received}-"));
        }
        let request = request.body(Full::default()).map_err(io::Error::other)?;
        let sent = connection.sender.send_request(request);
        let response = in_time(self.timeout, sent).await??;
        if !response.status().is_success() {
            return Err(DownloadError::Failed(
                refusal(response, self.timeout).await?,
            ));
        }
        let mut body = response.into_body();
        while let Some(frame) = in_time(self.timeout, body.frame()).await? {
            if let Ok(data) = frame?.into_data() {
                let written = out.write_all(&data);
                written.map_err(|error| DownloadError::Failed(write_failed(&error)))?;
                *received += data.len() as u64;
            }
        }
        Ok(())
    }
}
