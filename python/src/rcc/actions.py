"""Actions: what is to be done, as values that become nets. Reactions are in the net, in the cycle, never in Python."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .blocks import Action as Base
from .blocks import Held
from .expressions import Scope
from .tools import Net


@dataclass(frozen=True)
class End:
    """How an action ends: what is true from then on, and the conditions that name its outcome.

    `failures` describes those outcomes that mean failure.
    """

    done: Any
    outcomes: Mapping[str, Any] = field(default_factory=dict)
    failures: Mapping[str, str] = field(default_factory=dict)


class Action(Base):
    """Something to do: `cell.run(action)` does it, `cell.start(action)` begins it, `action.net()` shows its net."""

    name: str

    @abstractmethod
    def build(self, scope: Scope) -> End:
        """Adds what does it; returns how it ends."""

    def net(self, name: str | None = None) -> Net:
        """The net that does it."""
        scope = Scope(name or self.name)
        end = self.build(scope)
        if end.outcomes:
            outcomes = {outcome: end.done & holds for outcome, holds in end.outcomes.items()}
            scope.net.Termination(outcomes=outcomes, name="end")
        else:
            scope.net.Termination(done=end.done, name="end")
        net = scope.finish()
        net.failures.update(end.failures)
        return net

    def nets(self) -> list[Net]:
        """The nets, one after the other."""
        return [self.net()]


@dataclass(frozen=True)
class Together(Action):
    """Actions that begin in the same cycle; it ends when all have ended."""

    actions: tuple[Action, ...]
    name: str = "parallel"

    def build(self, scope: Scope) -> End:
        """Adds all of them to one net. A failure of one of them is a failure of the whole."""
        ends = [action.build(scope) for action in self.actions]
        done = ends[0].done
        for end in ends[1:]:
            # An end stays true: `done` of a motion does, and so does a time that is over.
            done = done & end.done
        failed: dict[str, Any] = {}
        failures: dict[str, str] = {}
        for end in ends:
            for outcome, description in end.failures.items():
                name = outcome if outcome not in failed else f"{outcome}_{len(failed) + 1}"
                failed[name] = scope.net.Latch(set=end.done & end.outcomes[outcome], reset=False)
                failures[name] = description
        outcomes: dict[str, Any] = {}
        any_failed: Any = None
        for name, holds in failed.items():
            outcomes[name] = holds if any_failed is None else holds & ~any_failed
            any_failed = holds if any_failed is None else any_failed | holds
        if any_failed is not None:
            outcomes["all_done"] = ~any_failed
        return End(done, outcomes, failures)


@dataclass(frozen=True)
class Steps(Base):
    """Actions one after the other, each a net of its own; the arm rests in between."""

    actions: tuple[Base, ...] = field(default_factory=tuple)

    def nets(self) -> list[Any]:
        """The nets of all actions."""
        return [net for action in self.actions for net in action.nets()]

    def held(self) -> list[Held]:
        """The outputs that must keep their value after a step."""
        return [held for action in self.actions for held in action.held()]


def parallel(first: Action, *others: Action) -> Together:
    """Actions in one net: they begin in the same cycle, and a CANCEL reaches all."""
    return Together((first, *others))
