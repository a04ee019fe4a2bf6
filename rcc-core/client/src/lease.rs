//! A lease: how the cell knows that this program lives. A thread of its own renews it, so that a program that computes or
//! waits keeps what it runs; the executor counts the time since the last renewal.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rcc_api::bodies::{LeaseBody, LeaseDone, LeaseGranted};
use rcc_api::codes;
use serde::de::DeserializeOwned;

use crate::error::{ClientError, RequestError};
use crate::transport::LoaderClient;

/// Renewals in the time after which a lease expires.
const RENEWALS: u32 = 5;
/// Shortest time that a renewal is given, unless the lease itself is shorter: networks and loaders answer later than some
/// leases are renewed.
const RENEWAL_MIN: Duration = Duration::from_millis(100);

/// The lease of a program, which is granted when it is first needed, and again when the cell has forgotten it. Dropping it
/// is the loss of the client for what it runs.
#[derive(Debug)]
pub struct LeaseHolder {
    lost_after: Duration,
    lease: Mutex<Option<Lease>>,
}

impl LeaseHolder {
    /// Returns a holder without a lease. Without a sign of life for `lost_after`, 50 ms to an hour, the program counts as
    /// lost; a thread gives it, not the program's own ones.
    #[must_use]
    pub fn new(lost_after: Duration) -> LeaseHolder {
        LeaseHolder {
            lost_after,
            lease: Mutex::default(),
        }
    }

    /// Sends a request that starts commands; `body` is made with the number of the lease to which they are bound.
    ///
    /// # Errors
    /// Fails if no lease can be granted, or if the loader refuses the request.
    pub fn begin<T: DeserializeOwned>(
        &self,
        client: &LoaderClient,
        path: &str,
        body: impl Fn(u64) -> Result<String, ClientError>,
    ) -> Result<T, ClientError> {
        let number = self.number(client, None)?;
        match client.post(path, body(number)?) {
            Err(error) if error.body.code == codes::UNKNOWN_LEASE.code => {}
            answer => return Ok(answer?),
        }
        // The lease expired unnoticed: this program was stopped for a while, or the executor was restarted.
        let number = self.number(client, Some(number))?;
        Ok(client.post(path, body(number)?)?)
    }

    /// Returns true when the cell has forgotten the lease: what was bound to it was canceled.
    pub fn is_lost(&self) -> bool {
        let held = self.lease.lock().unwrap_or_else(PoisonError::into_inner);
        held.as_ref().is_some_and(Lease::is_lost)
    }

    /// Returns the number of the lease; requests one if there is none, or if it is lost or is `expired`.
    fn number(&self, client: &LoaderClient, expired: Option<u64>) -> Result<u64, ClientError> {
        let mut held = self.lease.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(lease) = held.as_ref().filter(|lease| Some(lease.number) == expired) {
            // It must not be ended: the loader has said that it is not there.
            lease.set_lost();
        }
        if held.as_ref().is_some_and(Lease::is_lost) {
            *held = None;
        }
        let lease = match held.take() {
            Some(lease) => lease,
            None => Lease::grant(client, self.lost_after)?,
        };
        Ok(held.insert(lease).number)
    }
}

/// A lease that was granted. It ends when it is dropped: what is bound to it is canceled.
#[derive(Debug)]
pub(crate) struct Lease {
    /// Its number.
    pub number: u64,
    client: LoaderClient,
    ended: Option<Sender<()>>,
    // Written by the thread and by `set_lost`, read by `is_lost`.
    lost: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Lease {
    /// Asks for a lease that expires after this time without a renewal, and starts the thread.
    pub fn grant(client: &LoaderClient, expires: Duration) -> Result<Lease, ClientError> {
        let expires_ms = u64::try_from(expires.as_millis()).unwrap_or(u64::MAX);
        let granted: LeaseGranted =
            client.post("/leases", crate::json_text(&LeaseBody { expires_ms })?)?;
        let renewing = Renewing {
            client: client.another(renewal_max(expires))?,
            path: format!("/leases/{}/renew", granted.lease),
            pause: expires / RENEWALS,
            lost: Arc::default(),
        };
        let lost = Arc::clone(&renewing.lost);
        let (ended, is_ended) = channel();
        let thread = std::thread::Builder::new().name("rcc-lease".to_owned());
        let thread = thread.spawn(move || renewing.run(&is_ended));
        let thread = thread.map_err(|error| {
            let help = "close other programs to free resources";
            RequestError::new(codes::PROCESS_FAILED, error.to_string(), help)
        })?;
        Ok(Lease {
            number: granted.lease,
            client: client.another(expires)?,
            ended: Some(ended),
            lost,
            thread: Some(thread),
        })
    }

    /// Returns true when the cell has forgotten it: what was bound to it was canceled.
    pub fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Relaxed)
    }

    /// Marks the lease as lost: a refused START may report that before the next renewal does.
    pub fn set_lost(&self) {
        self.lost.store(true, Ordering::Relaxed);
    }
}

/// Returns the time after which a renewal is given up, so that one lost packet does not take the time of the others.
fn renewal_max(expires: Duration) -> Duration {
    (expires / RENEWALS).max(RENEWAL_MIN).min(expires)
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.ended = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been reported by its hook.
            let _ = thread.join();
        }
        if !self.is_lost() {
            // If the loader cannot be reached, the lease expires by itself.
            let _ = self
                .client
                .delete::<LeaseDone>(&format!("/leases/{}", self.number));
        }
    }
}

struct Renewing {
    client: LoaderClient,
    path: String,
    pause: Duration,
    // Read by `Lease::is_lost`. No other memory depends on it.
    lost: Arc<AtomicBool>,
}

impl Renewing {
    fn run(self, ended: &Receiver<()>) {
        while ended.recv_timeout(self.pause) == Err(RecvTimeoutError::Timeout) {
            let renewed = self.client.post::<LeaseDone>(&self.path, String::new());
            // Other errors: the loader is being restarted, or slow; the executor decides when it has been too long.
            if renewed.is_err_and(|error| error.body.code == codes::UNKNOWN_LEASE.code) {
                self.lost.store(true, Ordering::Relaxed);
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests;
