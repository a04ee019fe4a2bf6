//! The action of one arm: its requests, and the goal that moves it. Used by the serving thread.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, SyncSender};

use rcc_api::bodies::{CommandView, Done};
use rcc_api::codes::{UNKNOWN_COMMAND, WRONG_STATE};
use rcc_client::LoaderClient;
use rcc_recording::cdr::CdrWriter;
use rcc_recording::messages::{self, LogLevel};
use ros2_client::RmwRequestId;
use ros2_client::action::{GetResultResponse, SendGoalResponse};
use ros2_client::action_msgs::{
    CancelGoalRequest, CancelGoalResponse, CancelGoalResponseEnum, GoalId, GoalInfo, GoalStatusEnum,
};
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::Waker;

use super::TrajectoryServer;
use super::ending::{self, Ending};
use crate::cell::{ArmState, ArmStates};
use crate::node::RawPublisher;
use crate::raw::RawMessage;
use crate::trajectory::goals::{CancelFlag, CancelRequest, GoalTable};
use crate::trajectory::messages::{Feedback, Goal, Header, JointPoint, Outcome, Stamp};
use crate::trajectory::motion::Refusal;
use crate::trajectory::starter::{GoalStarter, StartedGoal};

/// Requests for results that wait; beyond it the oldest is dropped.
const ASKED_MAX: usize = 256;

/// A goal that is to be started.
pub(super) struct WantedGoal {
    request: RmwRequestId,
    id: GoalId,
    goal: Box<Goal>,
    canceled: CancelFlag,
}

/// News about a goal.
pub(super) struct GoalNews {
    pub device: String,
    request: RmwRequestId,
    id: GoalId,
    result: Result<StartedGoal, Refusal>,
}

/// Returns what the thread does that starts the goals of an arm.
pub(super) fn work(
    device: String,
    mut starter: GoalStarter,
    waiting: Receiver<WantedGoal>,
    told: Sender<GoalNews>,
    waker: Arc<Waker>,
) -> impl FnOnce() + Send + 'static {
    move || {
        for wanted in waiting {
            let news = GoalNews {
                device: device.clone(),
                request: wanted.request,
                id: wanted.id,
                result: starter.start(&wanted.goal, &wanted.canceled),
            };
            if told.send(news).is_err() || waker.wake().is_err() {
                return;
            }
        }
    }
}

/// The goal that moves the arm.
struct ActiveGoal {
    id: GoalId,
    started: StartedGoal,
    /// A client has asked for CANCEL.
    is_canceled: bool,
    /// The deviation from the path for which it was canceled.
    violation: Option<String>,
}

/// The action of one arm.
pub(super) struct ArmAction {
    device: String,
    server: TrajectoryServer,
    /// `/rosout`.
    log: RawPublisher,
    wanted: SyncSender<WantedGoal>,
    goals: GoalTable,
    active: Option<ActiveGoal>,
    /// Requests for results of goals that have not ended.
    asked: Vec<(RmwRequestId, GoalId)>,
}

impl ArmAction {
    pub fn new(
        device: &str,
        (server, log): (TrajectoryServer, RawPublisher),
        wanted: SyncSender<WantedGoal>,
    ) -> ArmAction {
        ArmAction {
            device: device.to_owned(),
            server,
            log,
            wanted,
            goals: GoalTable::default(),
            active: None,
            asked: Vec::new(),
        }
    }

    pub fn moves(&self) -> bool {
        self.active.is_some()
    }

    /// Takes all requests. Goals first: DDS keeps no order between two services, and a CANCEL must reach every goal that was
    /// sent before it. It may so mean one that was sent after it, which then does not move the arm.
    pub fn serve(&mut self, client: &LoaderClient) {
        while let Some((request, asked)) = taken(self.server.receive_goal()) {
            let id = asked.goal_id;
            if let Err(words) = self.want(request, id, asked.goal) {
                self.answer_goal(request, id, Some(words));
            }
        }
        while let Some((request, asked)) = taken(self.server.receive_cancel_request()) {
            self.cancel(client, request, &asked);
        }
        while let Some((request, asked)) = taken(self.server.receive_result_request()) {
            if self.asked.len() >= ASKED_MAX {
                self.asked.remove(0);
            }
            self.asked.push((request, asked.goal_id));
        }
        self.answer_results();
    }

    /// Gives a goal to the thread that starts them, or returns why not.
    fn want(&mut self, request: RmwRequestId, id: GoalId, goal: Goal) -> Result<(), &'static str> {
        if self.goals.knows(id) {
            return Err("a goal of this id was sent before");
        }
        let canceled = CancelFlag::default();
        let wanted = WantedGoal {
            request,
            id,
            goal: Box::new(goal),
            canceled: canceled.clone(),
        };
        let sent = self.wanted.try_send(wanted);
        sent.map_err(|_| "too many goals wait: send one after the other")?;
        self.goals.wait(id, Time::now(), canceled);
        Ok(())
    }

    /// Takes what the thread has done that starts goals.
    pub fn started(&mut self, client: &LoaderClient, news: GoalNews) {
        let is_canceled = self.goals.end_wait(news.id);
        match news.result {
            // Whoever canceled it was told so: it was a goal, and has ended.
            Err(_) if is_canceled => {
                self.goals.accept(news.id, Time::now());
                self.answer_goal(news.request, news.id, None);
                self.end(news.id, ending::not_started());
            }
            Err(Refusal(outcome)) => {
                self.answer_goal(news.request, news.id, Some(&outcome.error_string));
                self.goals.refuse(news.id, outcome);
            }
            Ok(started) => {
                if let Some(replaced) = self.active.take() {
                    self.end(replaced.id, ending::replaced());
                    unload(client, replaced.started.command);
                }
                self.goals.accept(news.id, Time::now());
                self.answer_goal(news.request, news.id, None);
                let command = started.command;
                self.active = Some(ActiveGoal {
                    id: news.id,
                    started,
                    is_canceled,
                    violation: None,
                });
                // The starter has looked just before START.
                if is_canceled {
                    self.goals.set(news.id, GoalStatusEnum::Canceling);
                    self.cancel_again(client, command);
                }
            }
        }
        self.publish_states();
        self.answer_results();
    }

    fn answer_goal(&self, request: RmwRequestId, id: GoalId, refusal: Option<&str>) {
        match refusal {
            None => tracing::info!(device = self.device, ?id, "the goal is accepted"),
            // ROS has no field for it in this answer; the log and the result have.
            Some(words) => {
                let words = format!("the goal is refused: {words}");
                tracing::warn!(device = self.device, ?id, "{words}");
                self.log(&words);
            }
        }
        let answer = SendGoalResponse {
            accepted: refusal.is_none(),
            stamp: Time::now(),
        };
        told(self.server.send_goal_response(request, answer));
    }

    /// Writes an error to `/rosout`.
    fn log(&self, words: &str) {
        let ns = rcc_os::wall::since_epoch().as_nanos();
        let ns = u64::try_from(ns).unwrap_or(u64::MAX);
        let mut out = CdrWriter::new();
        messages::log(&mut out, ns, LogLevel::Error, [&self.device, words]);
        if let Err(error) = self.log.publish(RawMessage::of(out.bytes())) {
            tracing::debug!(?error, "a message is dropped");
        }
    }

    fn cancel(&mut self, client: &LoaderClient, request: RmwRequestId, asked: &CancelGoalRequest) {
        let asked = serde_json::to_value(asked).and_then(serde_json::from_value::<CancelRequest>);
        let Ok(asked) = asked else { return };
        let meant = self.goals.meant(&asked);
        let known = self.goals.of(asked.goal_info.goal_id);
        let mut return_code = match known {
            Some(goal) if goal.outcome.is_some() => CancelGoalResponseEnum::GoalTerminated,
            None if meant.is_empty() => CancelGoalResponseEnum::UnknownGoal,
            _ => CancelGoalResponseEnum::Rejected,
        };
        let mut goals_canceling = self.goals.cancel_pending(&asked);
        if !goals_canceling.is_empty() {
            return_code = CancelGoalResponseEnum::None;
        }
        if let Some(active) = self
            .active
            .as_mut()
            .filter(|active| meant.contains(&active.id))
        {
            match cancel_net(client, active.started.command) {
                Ok(()) => {
                    active.is_canceled = true;
                    self.goals.set(active.id, GoalStatusEnum::Canceling);
                    return_code = CancelGoalResponseEnum::None;
                    let accepted = self.goals.of(active.id).and_then(|goal| goal.accepted);
                    goals_canceling.push(GoalInfo {
                        goal_id: active.id,
                        stamp: accepted.unwrap_or(Time::ZERO),
                    });
                }
                Err(words) => tracing::warn!(device = self.device, "CANCEL is refused: {words}"),
            }
        }
        let answer = CancelGoalResponse {
            return_code,
            goals_canceling,
        };
        told(self.server.send_cancel_response(request, answer));
        self.publish_states();
    }

    /// CANCEL of a net whose goal was canceled before; [`ArmAction::turn`] repeats it until the net is canceled.
    fn cancel_again(&self, client: &LoaderClient, command: u64) {
        if let Err(words) = cancel_net(client, command) {
            tracing::warn!(device = self.device, "CANCEL is refused: {words}");
        }
    }

    /// Sends feedback, or ends the goal whose net has ended.
    pub fn turn(&mut self, client: &LoaderClient, states: &ArmStates) {
        let Some(active) = &self.active else { return };
        let command = active.started.command;
        let view = client.get::<CommandView>(&format!("/commands/{command}?brief=true"));
        let state = states.of(&self.device);
        let ending = match view {
            Ok(view) if view.state == "terminated" => {
                // The goal that replaces it says so.
                if self.goals.waits() && view.reason.as_deref() != Some("finished") {
                    return;
                }
                let goal = ending::EndedGoal {
                    is_canceled: active.is_canceled,
                    violation: active.violation.as_deref(),
                    started: &active.started,
                    position: state.as_ref().map(|state| state.position.as_slice()),
                };
                ending::of(&view, &goal)
            }
            Ok(view) => {
                if active.is_canceled && view.state == "running" {
                    self.cancel_again(client, command);
                }
                if let Some(state) = state {
                    self.feedback(client, &state);
                }
                return;
            }
            Err(error) if error.body.code == UNKNOWN_COMMAND.code => {
                ending::gone(&error.to_string())
            }
            // The loader is being restarted: the arm is the executor's, and goes on.
            Err(error) => {
                tracing::debug!(%error, "the state of a goal is not known");
                return;
            }
        };
        let id = active.id;
        self.active = None;
        self.end(id, ending);
        unload(client, command);
        self.publish_states();
        self.answer_results();
    }

    fn feedback(&mut self, client: &LoaderClient, state: &ArmState) {
        let Some(active) = &mut self.active else {
            return;
        };
        let pairs = state.commanded.iter().zip(&state.position);
        let errors: Vec<f64> = pairs.map(|(desired, actual)| desired - actual).collect();
        let point = |positions: Vec<f64>| JointPoint {
            positions,
            ..JointPoint::default()
        };
        let feedback = Feedback {
            header: Header {
                stamp: Stamp::now(),
                ..Header::default()
            },
            joint_names: active.started.joints.clone(),
            desired: point(state.commanded.clone()),
            actual: point(state.position.clone()),
            error: point(errors.clone()),
            ..Feedback::default()
        };
        if let Err(error) = self.server.send_feedback(active.id, feedback) {
            tracing::debug!(?error, "feedback is dropped");
        }
        if active.violation.is_some() {
            return;
        }
        let goal = &active.started;
        let violation = ending::violation(&goal.joints, &errors, &goal.motion.path_tolerance);
        if let Some(words) = violation {
            if let Err(error) = cancel_net(client, goal.command) {
                tracing::warn!(device = self.device, "CANCEL is refused: {error}");
            }
            active.violation = Some(words);
        }
    }

    fn end(&mut self, id: GoalId, ending: Ending) {
        let Ending { status, outcome } = ending;
        tracing::info!(
            device = self.device,
            ?id,
            ?status,
            outcome.error_string,
            "the goal has ended"
        );
        self.goals.end(id, status, outcome);
    }

    fn publish_states(&self) {
        if let Err(error) = self.server.send_goal_statuses(self.goals.statuses()) {
            tracing::debug!(?error, "the states of goals are not published");
        }
    }

    /// Answers the requests for results of goals that have ended, or that nobody knows.
    fn answer_results(&mut self) {
        let asked = std::mem::take(&mut self.asked);
        for (request, id) in asked {
            let (status, result) = match self.goals.of(id) {
                Some(goal) => match &goal.outcome {
                    Some(outcome) => (goal.status, outcome.clone()),
                    None => {
                        self.asked.push((request, id));
                        continue;
                    }
                },
                None if self.goals.is_pending(id) => {
                    self.asked.push((request, id));
                    continue;
                }
                None => (GoalStatusEnum::Unknown, Outcome::default()),
            };
            told(
                self.server
                    .send_result(request, GetResultResponse { status, result }),
            );
        }
    }
}

/// CANCEL of a command; one that comes to rest already, or has ended, needs none.
fn cancel_net(client: &LoaderClient, command: u64) -> Result<(), String> {
    let done: Result<Done, _> = client.post(&format!("/commands/{command}/cancel"), String::new());
    match done {
        Err(error) if error.body.code != WRONG_STATE.code => Err(error.to_string()),
        _ => Ok(()),
    }
}

fn unload(client: &LoaderClient, command: u64) {
    let unloaded: Result<Done, _> = client.delete(&format!("/commands/{command}"));
    if let Err(error) = unloaded {
        tracing::debug!(%error, "a net is not unloaded");
    }
}

/// Returns a request, if there is one; what is not understood is dropped, as there is nobody to answer.
fn taken<T, E: std::fmt::Debug>(received: Result<Option<T>, E>) -> Option<T> {
    match received {
        Ok(request) => request,
        Err(error) => {
            tracing::debug!(?error, "a request is not understood");
            None
        }
    }
}

fn told<E: std::fmt::Debug>(sent: Result<(), E>) {
    if let Err(error) = sent {
        tracing::debug!(?error, "a request is not answered");
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use rcc_api::codes::DEVICE_NOT_READY;
    use serde_json::json;

    use super::*;
    use crate::trajectory::fake_loader::FakeLoader;

    #[test]
    fn a_net_that_comes_to_rest_already_is_canceled() {
        let loader = FakeLoader::new(|request| match request {
            "POST /commands/7/cancel" => Ok(json!({"id": 7, "net": "goal", "cycle": 1})),
            "POST /commands/8/cancel" => Err(WRONG_STATE.code),
            _ => Err(DEVICE_NOT_READY.code),
        });
        let client = LoaderClient::new("test", &loader.socket, Duration::from_secs(60));
        let client = client.expect("a client");
        assert_eq!(cancel_net(&client, 7), Ok(()));
        assert_eq!(cancel_net(&client, 8), Ok(()));
        let refused = cancel_net(&client, 9).expect_err("refused");
        assert!(refused.contains(DEVICE_NOT_READY.code), "{refused}");
    }
}
