//! Nets that are built for LOAD and, if an arm rests elsewhere by then, again for START. Run by the intake thread; the
//! net-builder thread does the work.

use std::collections::BTreeMap;

use rcc_engine::net::{Net, NetOrigin};
use rcc_ipc::request::Request;
use rcc_protocol::control::{Answer, Call, InputValue, Refusal};
use rcc_protocol::rehearsal::RehearsalReport;

use super::{Intake, OnDone, PendingRequest, commands_of, reply};
use crate::boards::EngineRequest;
use crate::net_builder::{BuildOutcome, BuildRequest, BuildSource, DeviceSnapshot};

/// Purpose for which the net of a command is being built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BuildState {
    /// LOAD.
    New,
    /// START: an arm rests elsewhere than at LOAD.
    ForStart {
        /// The lease of the START; 0: none.
        lease: u64,
    },
    /// A START that a CANCEL or ABORT has withdrawn.
    Withdrawn,
}

/// A command that is ready but not started. Its net is rebuilt from `origin` if an arm rests elsewhere at START.
pub(super) struct ReadyCommand {
    pub(super) origin: NetOrigin,
    /// Bit d is set if the net commands the arm of device d.
    pub(super) arms: u64,
    /// Values that were set since LOAD, by input.
    pub(super) values: BTreeMap<u32, Vec<u64>>,
}

impl Intake {
    /// Returns true if the call names a command whose net is being built.
    pub(super) fn awaits_build(&self, call: &Call) -> bool {
        let commands = commands_of(call);
        commands.iter().any(|id| self.building.contains_key(id))
    }

    /// A client stops this command: refuses a START for which its net is being built again, and every deferred call that
    /// would start something and names it.
    pub(super) fn withdraw(&mut self, id: u64) {
        if let Some(state @ BuildState::ForStart { .. }) = self.building.get_mut(&id) {
            *state = BuildState::Withdrawn;
        }
        let starts = |call: &Call| match call {
            Call::Start { id: other, .. } => *other == id,
            Call::Switch { stop, start, .. } => {
                !start.is_empty() && (stop.contains(&id) || start.contains(&id))
            }
            Call::InstallRules { rules } => {
                let mut rules = rules.iter().map(|new| &new.rule);
                rules.any(|rule| rule.starts() && rule.names(id))
            }
            _ => false,
        };
        for (call, request) in std::mem::take(&mut self.deferred) {
            if starts(&call) {
                reply(request, &Answer::Refused(Refusal::Withdrawn));
            } else {
                self.deferred.push_back((call, request));
            }
        }
    }

    /// Leaves commands out of a hand-over that only stops, if they are ready because their START was withdrawn.
    pub(super) fn without_withdrawn(&self, mut call: Call) -> Call {
        if let Call::Switch { stop, .. } = &mut call {
            stop.retain(|id| self.building.get(id) != Some(&BuildState::Withdrawn));
        }
        call
    }

    /// The action for the answer to a CANCEL or ABORT.
    pub(super) fn on_stopped(&self, id: u64) -> OnDone {
        match self.building.get(&id) {
            Some(BuildState::Withdrawn) => OnDone::Withdrawn,
            _ => OnDone::Nothing,
        }
    }

    /// Submits a net to be built, for a START with this lease or for LOAD; the request stays pending.
    pub(super) fn build(
        &mut self,
        build_request: BuildRequest,
        start: Option<u64>,
        request: Request,
    ) {
        let (ticket, id) = (build_request.ticket, build_request.id);
        match self.net_builder.submit(build_request) {
            Ok(()) => {
                let state = self.building.entry(id).or_insert(BuildState::New);
                if let Some(lease) = start {
                    *state = BuildState::ForStart { lease };
                }
                let on_done = OnDone::Nothing;
                self.pending
                    .insert(ticket, PendingRequest { request, on_done });
            }
            Err(refusal) => reply(request, &Answer::Refused(refusal)),
        }
    }

    /// Handles the end of a build: the command becomes ready or rejected; after a rebuild it is started or stays ready.
    pub(super) fn handle_build_outcome(&mut self, outcome: BuildOutcome) {
        let BuildOutcome {
            ticket,
            id,
            rebuild,
            net,
        } = outcome;
        let (net, lease) = match self.building.remove(&id) {
            Some(BuildState::Withdrawn) => (Err(Refusal::Withdrawn), 0),
            Some(BuildState::ForStart { lease }) => (net, lease),
            Some(BuildState::New) | None => (net, 0),
        };
        let pending = self.pending.remove(&ticket);
        if let Some(PendingRequest { request, .. }) = pending {
            // Whoever has given up waiting was told of an error: nothing of it takes effect afterwards.
            let net = match request.is_awaited() {
                true => net,
                false => Err(Refusal::Withdrawn),
            };
            match net {
                Ok((net, rehearsed)) if rebuild => {
                    self.start_rebuilt((ticket, id, lease), net, rehearsed, request)
                }
                Ok((net, rehearsed)) => {
                    let ready = ReadyCommand {
                        origin: net.origin(),
                        arms: net.resources().arms,
                        values: BTreeMap::new(),
                    };
                    let on_done = OnDone::Ready(id, rehearsed, ready);
                    let engine_request = EngineRequest::Install { ticket, id, net };
                    self.submit(
                        engine_request,
                        Some((ticket, PendingRequest { request, on_done })),
                    );
                }
                Err(refusal) => {
                    reply(request, &Answer::Refused(refusal));
                    if !rebuild {
                        // Ticket 0, because the caller already has the reason.
                        self.submit(EngineRequest::Reject { ticket: 0, id }, None);
                    }
                }
            }
        }
        for (call, request) in std::mem::take(&mut self.deferred) {
            if self.awaits_build(&call) {
                self.deferred.push_back((call, request));
            } else if request.is_awaited() {
                self.dispatch(call, request);
            }
        }
    }

    /// Starts a command whose net was rebuilt: the new net replaces the one that was ready.
    fn start_rebuilt(
        &mut self,
        (ticket, id, lease): (u64, u64, u64),
        net: Box<Net>,
        rehearsed: Option<RehearsalReport>,
        request: Request,
    ) {
        let origin = net.origin();
        if self
            .engine_requests
            .push(EngineRequest::Renew { id, net })
            .is_err()
        {
            return reply(request, &Answer::Refused(Refusal::Overloaded));
        }
        self.send_origin(id, &origin);
        if let Some(ready) = self.ready.get_mut(&id) {
            ready.origin = origin;
        }
        let on_done = OnDone::Started(vec![id], rehearsed);
        let engine_request = EngineRequest::Start { ticket, id, lease };
        self.submit(
            engine_request,
            Some((ticket, PendingRequest { request, on_done })),
        );
    }

    /// Sends the origin of a net to the writer of incident files.
    pub(super) fn send_origin(&self, id: u64, origin: &NetOrigin) {
        if let Some(incident_writer) = &self.incident_writer {
            // The receiver is gone only when the executor ends.
            let _ = incident_writer.send((id, origin.clone()));
        }
    }

    /// Returns what the net of a command must be rebuilt from before START: its arms are at rest, and at least one of
    /// them elsewhere than when the net was built. Returns `None` while an arm moves; START itself then refuses.
    pub(super) fn rebuild_source(&self, id: u64, snapshot: &DeviceSnapshot) -> Option<BuildSource> {
        let ready = self.ready.get(&id)?;
        let mut same = true;
        for device in (0..snapshot.devices.len()).filter(|device| ready.arms >> device & 1 == 1) {
            let rests = snapshot.rest_position(device)?;
            let conditions = &ready.origin.start_conditions;
            let built_for = conditions.holds.get(device).copied().flatten();
            same &= built_for == Some(rests);
        }
        let value = |(input, words): (&u32, &Vec<u64>)| InputValue {
            input: *input,
            words: words.clone(),
        };
        let values = || ready.values.iter().map(value).collect();
        (!same).then(|| BuildSource::Rebuild(ready.origin.clone(), values()))
    }
}
