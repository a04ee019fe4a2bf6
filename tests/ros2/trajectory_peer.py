"""A client of `control_msgs/FollowJointTrajectory` on Cyclone DDS, with messages written by hand: nothing of it is RCC's.

Requests and answers are those of `rmw_cyclonedds_cpp`: each begins with the client's number and that of the request.
"""

import random
import time
import uuid
from dataclasses import dataclass, field

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, annotations
from cyclonedds.idl.types import array, float64, int8, int32, int64, sequence, uint8, uint16, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(1, 7)




@annotations.final
@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@annotations.final
@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@annotations.final
@dataclass
class Point(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64] = field(default_factory=list)
    velocities: sequence[float64] = field(default_factory=list)
    accelerations: sequence[float64] = field(default_factory=list)
    effort: sequence[float64] = field(default_factory=list)
    time_from_start: Time = field(default_factory=Time)


@annotations.final
@dataclass
class Trajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header = field(default_factory=Header)
    joint_names: sequence[str] = field(default_factory=list)
    points: sequence[Point] = field(default_factory=list)


@annotations.final
@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    values: array[float64, 7]


@annotations.final
@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    values: array[float64, 6]


@annotations.final
@dataclass
class MultiDofPoint(IdlStruct, typename="trajectory_msgs::msg::dds_::MultiDOFJointTrajectoryPoint_"):
    transforms: sequence[Transform] = field(default_factory=list)
    velocities: sequence[Twist] = field(default_factory=list)
    accelerations: sequence[Twist] = field(default_factory=list)
    time_from_start: Time = field(default_factory=Time)


@annotations.final
@dataclass
class MultiDofTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::MultiDOFJointTrajectory_"):
    header: Header = field(default_factory=Header)
    joint_names: sequence[str] = field(default_factory=list)
    points: sequence[MultiDofPoint] = field(default_factory=list)


@annotations.final
@dataclass
class Tolerance(IdlStruct, typename="control_msgs::msg::dds_::JointTolerance_"):
    name: str = ""
    position: float64 = 0.0
    velocity: float64 = 0.0
    acceleration: float64 = 0.0


@annotations.final
@dataclass
class ComponentTolerance(IdlStruct, typename="control_msgs::msg::dds_::JointComponentTolerance_"):
    joint_name: str = ""
    component: uint16 = 0
    position: float64 = 0.0
    velocity: float64 = 0.0
    acceleration: float64 = 0.0


@annotations.final
@dataclass
class Goal(IdlStruct, typename="control_msgs::action::dds_::FollowJointTrajectory_Goal_"):
    trajectory: Trajectory = field(default_factory=Trajectory)
    multi_dof_trajectory: MultiDofTrajectory = field(default_factory=MultiDofTrajectory)
    path_tolerance: sequence[Tolerance] = field(default_factory=list)
    component_path_tolerance: sequence[ComponentTolerance] = field(default_factory=list)
    goal_tolerance: sequence[Tolerance] = field(default_factory=list)
    component_goal_tolerance: sequence[ComponentTolerance] = field(default_factory=list)
    goal_time_tolerance: Time = field(default_factory=Time)


@annotations.final
@dataclass
class SendGoalRequest(IdlStruct, typename="control_msgs::action::dds_::FollowJointTrajectory_SendGoal_Request_"):
    client: uint64
    number: int64
    goal_id: array[uint8, 16]
    goal: Goal


@annotations.final
@dataclass
class SendGoalAnswer(IdlStruct, typename="control_msgs::action::dds_::FollowJointTrajectory_SendGoal_Response_"):
    client: uint64
    number: int64
    accepted: bool
    stamp: Time


@annotations.final
@dataclass
class CancelRequest(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Request_"):
    client: uint64
    number: int64
    goal_id: array[uint8, 16]
    stamp: Time


@annotations.final
@dataclass
class GoalInfo(IdlStruct, typename="action_msgs::msg::dds_::GoalInfo_"):
    goal_id: array[uint8, 16]
    stamp: Time


@annotations.final
@dataclass
class CancelAnswer(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Response_"):
    client: uint64
    number: int64
    return_code: int8
    goals_canceling: sequence[GoalInfo]


@annotations.final
@dataclass
class ResultRequest(IdlStruct, typename="control_msgs::action::dds_::FollowJointTrajectory_GetResult_Request_"):
    client: uint64
    number: int64
    goal_id: array[uint8, 16]


@annotations.final
@dataclass
class ResultAnswer(IdlStruct, typename="control_msgs::action::dds_::FollowJointTrajectory_GetResult_Response_"):
    client: uint64
    number: int64
    status: int8
    error_code: int32
    error_string: str


@annotations.final
@dataclass
class FeedbackMessage(IdlStruct, typename="control_msgs::action::dds_::FollowJointTrajectory_FeedbackMessage_"):
    goal_id: array[uint8, 16]
    header: Header
    joint_names: sequence[str]
    desired: Point
    actual: Point
    error: Point
    multi_dof_joint_names: sequence[str]
    multi_dof_desired: MultiDofPoint
    multi_dof_actual: MultiDofPoint
    multi_dof_error: MultiDofPoint


RELIABLE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(100),
)


class Service:
    """A client of one service."""

    def __init__(self, participant, name, request, answer):
        self.client = random.getrandbits(63)
        self.number = 0
        self.request = request
        requests = Topic(participant, f"rq{name}Request", request, qos=RELIABLE)
        answers = Topic(participant, f"rr{name}Reply", answer, qos=RELIABLE)
        self.writer = DataWriter(participant, requests, qos=RELIABLE)
        self.reader = DataReader(participant, answers, qos=RELIABLE)
        self.answers = {}

    def is_there(self):
        """True if the server has found both topics, and is found."""
        return bool(self.writer.get_matched_subscriptions()) and bool(self.reader.get_matched_publications())

    def send(self, *fields):
        self.number += 1
        self.writer.write(self.request(self.client, self.number, *fields))
        return self.number

    def answer(self, number, limit_s=60.0):
        end = time.monotonic() + limit_s
        while number not in self.answers:
            for answer in self.reader.take_iter(timeout=duration(milliseconds=100)):
                if answer.client == self.client:
                    self.answers[answer.number] = answer
            assert time.monotonic() < end, f"no answer of {self.request.__name__}"
        return self.answers.pop(number)

    def call(self, *fields, limit_s=60.0):
        return self.answer(self.send(*fields), limit_s)


class TrajectoryClient:
    """A client of the action of one arm."""

    def __init__(self, domain, arm):
        participant = DomainParticipant(domain)
        action = f"/{arm}/follow_joint_trajectory/_action"
        self.goals = Service(participant, f"{action}/send_goal", SendGoalRequest, SendGoalAnswer)
        self.cancels = Service(participant, f"{action}/cancel_goal", CancelRequest, CancelAnswer)
        self.results = Service(participant, f"{action}/get_result", ResultRequest, ResultAnswer)
        topic = Topic(participant, f"rt{action}/feedback", FeedbackMessage, qos=RELIABLE)
        self.reader = DataReader(participant, topic, qos=RELIABLE)
        self.participant = participant

    def await_server(self, limit_s=30.0):
        end = time.monotonic() + limit_s
        services = (self.goals, self.cancels, self.results)
        while not (all(one.is_there() for one in services) and self.reader.get_matched_publications()):
            assert time.monotonic() < end, "no action server"
            time.sleep(0.02)

    def begin(self, goal):
        """Sends a goal, and returns its id and the number of the request."""
        goal_id = list(uuid.uuid4().bytes)
        return goal_id, self.goals.send(goal_id, goal)

    def send(self, goal):
        """Returns the id, and whether the goal was accepted."""
        goal_id, number = self.begin(goal)
        return goal_id, self.goals.answer(number).accepted

    def result(self, goal_id, limit_s=60.0):
        answer = self.results.call(goal_id, limit_s=limit_s)
        return answer.status, answer.error_code, answer.error_string

    def cancel(self, goal_id):
        answer = self.cancels.call(goal_id, Time())
        return answer.return_code, [list(info.goal_id) for info in answer.goals_canceling]

    def cancel_all(self):
        return self.cancel([0] * 16)

    def feedback(self):
        return list(self.reader.take(1000))


def goal(joints, *points, **further):
    """A goal through points: (time in s, positions)."""

    def point(time_s, positions):
        whole = int(time_s)
        return Point(positions=list(positions), time_from_start=Time(whole, round((time_s - whole) * 1e9)))

    return Goal(trajectory=Trajectory(joint_names=list(joints), points=[point(*one) for one in points]), **further)
