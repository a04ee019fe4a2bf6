//! The connection to a loader that a cell and its commands share: requests, the lease of what they start, and streams.
//! Blocks the calling thread.

use std::time::Duration;

use rcc_api::bodies::OnClientLoss;
use serde::de::DeserializeOwned;

use crate::error::ClientError;
use crate::lease::LeaseHolder;
use crate::transport::{LoaderClient, segment};
use crate::watch::Watch;

/// Time without a sign of life after which a program counts as lost, unless it says otherwise.
const LOST_AFTER: Duration = Duration::from_secs(1);

/// A connection to a loader. Dropping it is the loss of the client for what it runs.
#[derive(Debug)]
pub struct Connection {
    pub client: LoaderClient,
    pub lease: LeaseHolder,
}

impl Connection {
    pub fn new(client: LoaderClient) -> Connection {
        Connection {
            client,
            lease: LeaseHolder::new(LOST_AFTER),
        }
    }

    /// Returns this connection with another time after which the program counts as lost.
    pub fn with_lost_after(self, lost_after: Duration) -> Connection {
        Connection {
            lease: LeaseHolder::new(lost_after),
            ..self
        }
    }

    /// Sends a request that starts commands; `body` is made with the lease to which they are bound, if any.
    pub fn begin<T: DeserializeOwned>(
        &self,
        path: &str,
        on_client_loss: OnClientLoss,
        body: impl Fn(Option<u64>) -> Result<String, ClientError>,
    ) -> Result<T, ClientError> {
        if on_client_loss == OnClientLoss::GoOn {
            return Ok(self.client.post(path, body(None)?)?);
        }
        self.lease
            .begin(&self.client, path, |number| body(Some(number)))
    }

    /// Watches values of ports, at a rate, Hz.
    pub fn watch(&self, ports: &[&str], rate: f64) -> Result<Watch<'_>, ClientError> {
        let ports: Vec<String> = ports.iter().map(|port| segment(port)).collect();
        let path = format!("/stream?ports={}&rate={rate}", ports.join(","));
        Ok(Watch::new(self.client.lines(&path)?))
    }
}
