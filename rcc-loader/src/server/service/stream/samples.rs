//! The sampled values of a stream, and how a command that is named by its id ends in it. Run by the stream's worker thread.

use rcc_api::streams::{StreamPort, StreamPorts, StreamValues};
use rcc_core::message::CommandState;
use rcc_protocol::control::{Answer, Call};

use super::{EventStream, Subscription, Target};
use crate::server::live::LiveSender;
use crate::server::service::Service;
use crate::server::service::values::view;

/// How a command can show no more values.
enum CommandEnd {
    /// Its last values can be read.
    Terminated,
    /// It was rejected or unloaded, or its executor has ended.
    Gone,
}

/// Result of reading the ports of a net.
enum Reading {
    Values(StreamValues),
    /// Nothing new.
    Unchanged,
    /// The executor does not answer, or the client has no room.
    Missed,
}

impl EventStream {
    /// Sends the values of all nets that were evaluated since the last sample.
    pub(super) fn sample(&mut self, service: &Service, client: &LiveSender) {
        let mut subscriptions = std::mem::take(&mut self.subscriptions);
        for subscription in subscriptions.iter_mut().filter(|one| !one.is_over) {
            if let Reading::Values(values) = self.read(service, client, subscription) {
                let is_sent = self.send(client, "values", &values);
                self.loss.samples += u64::from(!is_sent);
            }
        }
        self.subscriptions = subscriptions;
    }

    /// Sends the last values of commands that are named by their ids and have ended.
    pub(super) fn look_at_ends(&mut self, service: &Service, client: &LiveSender) {
        let mut subscriptions = std::mem::take(&mut self.subscriptions);
        for subscription in subscriptions.iter_mut().filter(|one| !one.is_over) {
            let Some(id) = subscription.id() else {
                continue;
            };
            // Values that are read after the end are the last ones.
            match self.has_ended(service, id) {
                Some(CommandEnd::Gone) => subscription.is_over = true,
                Some(CommandEnd::Terminated) => {
                    subscription.is_over = match self.read(service, client, subscription) {
                        Reading::Values(values) => {
                            let is_sent = self.send(client, "values", &values);
                            if let Some(target) = subscription.target.as_mut().filter(|_| !is_sent)
                            {
                                // They are sent when the client has room.
                                target.evaluations = None;
                            }
                            is_sent
                        }
                        Reading::Unchanged => true,
                        Reading::Missed => false,
                    };
                }
                None => {}
            }
        }
        self.subscriptions = subscriptions;
    }

    /// Returns how a command can show no more values; `None` while it can, or while no executor answers.
    fn has_ended(&self, service: &Service, id: u64) -> Option<CommandEnd> {
        let (attached, _) = service.attach().ok()?;
        if attached.announcement.incarnation != self.incarnation {
            return Some(CommandEnd::Gone);
        }
        let Some(row) = attached.tables().command(id).copied() else {
            let is_loading = service.loading.get().contains_key(&id);
            return (!is_loading).then_some(CommandEnd::Gone);
        };
        match CommandState::from_number(row.state) {
            CommandState::Terminated => Some(CommandEnd::Terminated),
            CommandState::Rejected => Some(CommandEnd::Gone),
            _ => None,
        }
    }

    /// Reads the ports of one net.
    fn read(
        &mut self,
        service: &Service,
        client: &LiveSender,
        subscription: &mut Subscription,
    ) -> Reading {
        let Ok((attached, store)) = service.attach() else {
            return Reading::Missed;
        };
        let is_other = attached.announcement.incarnation != self.incarnation;
        if is_other && subscription.id().is_some() {
            // The id means another command there.
            return Reading::Missed;
        }
        let active = |state: CommandState| state.is_active();
        let id = service.resolve(|| attached.tables(), &store, &subscription.net, active);
        let Ok(id) = id else {
            return Reading::Unchanged;
        };
        let known = subscription.target.as_ref();
        if known.is_none_or(|target| target.id != id) {
            // A net of this name without these ports, or that is still being loaded, shows nothing.
            subscription.target = service.target(&attached, &store, subscription).ok();
        }
        let Some(target) = subscription.target.as_mut() else {
            return Reading::Unchanged;
        };
        let points = target.selected.iter().map(|port| port.point).collect();
        let answer = match self.port.as_ref() {
            Some(port) => port.call(&Call::Read { id, points }),
            None => return Reading::Missed,
        };
        let values = match answer {
            Ok(Answer::Values(values)) => values,
            // For example, it has not been started.
            Ok(_) => return Reading::Unchanged,
            Err(_) => {
                self.port = None;
                return Reading::Missed;
            }
        };
        if values.evaluations == 0 || target.evaluations == Some(values.evaluations) {
            return Reading::Unchanged;
        }
        if !target.is_announced {
            target.is_announced = self.send(client, "ports", &announcement(target));
            if !target.is_announced {
                self.loss.samples += 1;
                return Reading::Missed;
            }
        }
        target.evaluations = Some(values.evaluations);
        let period_ns = attached.status().period_ns;
        let view = view(id, &target.net, period_ns, &target.selected, &values);
        let values = view.values.into_iter();
        Reading::Values(StreamValues {
            id,
            net: view.net,
            cycle: view.cycle,
            net_cycle: view.net_cycle,
            time_s: view.time_s,
            values: values.map(|value| (value.port, value.value)).collect(),
        })
    }
}

fn announcement(target: &Target) -> StreamPorts {
    let ports = target.selected.iter().map(|port| StreamPort {
        port: port.port.clone(),
        ty: port.ty.clone(),
        unit: port.unit.clone(),
    });
    StreamPorts {
        id: target.id,
        net: target.net.clone(),
        ports: ports.collect(),
    }
}
