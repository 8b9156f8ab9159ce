"""The table of states of alarms does what ISA-18.2's figure says: against a model of what is true of an alarm."""

from __future__ import annotations

import hypothesis.strategies as st
from hypothesis import given

from umo.operation.alarms import AlarmState, Operation
from umo.operation.alarms.alarm_states import ANNUNCIATED, PUT_AWAY, TO_BE_ACKNOWLEDGED, transitions

S = AlarmState


class Model:
    """An alarm as facts: what is true of it, and not which state it is in."""

    def __init__(self, latch: bool, asks: bool) -> None:
        self.latch, self.asks = latch, asks
        self.condition = "false"
        self.unacknowledged = self.held = False
        self.away = ""

    def happens(self, operation: Operation) -> None:
        if operation in (Operation.INACTIVE, Operation.ACTIVE, Operation.CANNOT_EVALUATE):
            self.evaluated(
                {Operation.INACTIVE: "false", Operation.ACTIVE: "true", Operation.CANNOT_EVALUATE: "bad"}[operation]
            )
        elif operation is Operation.ACKNOWLEDGE:
            self.unacknowledged = False
        elif operation is Operation.RESET:
            if not self.unacknowledged and self.condition == "false":
                self.held = False
        elif operation is Operation.SHELVE:
            if self.away != "out of service":
                self.put("shelved", self.condition)
        elif operation is Operation.REMOVE:
            self.put("out of service")
        elif self.away == {Operation.UNSHELVE: "shelved", Operation.RETURN: "out of service"}[operation]:
            self.away, self.condition = "", "false"

    def evaluated(self, condition: str) -> None:
        if self.away:
            self.condition = condition if self.away == "shelved" else "false"
            return
        if condition != "false" and condition != self.condition:
            self.unacknowledged = self.asks
            self.held = self.latch
        self.condition = condition

    def put(self, away: str, condition: str = "false") -> None:
        self.away, self.unacknowledged, self.held, self.condition = away, False, False, condition

    @property
    def state(self) -> str:
        if self.away:
            return self.away if self.condition == "false" else "shelved active"
        if self.condition == "bad":
            return "bad unacknowledged" if self.unacknowledged else "bad acknowledged"
        if self.condition == "true":
            return "unacknowledged" if self.unacknowledged else "acknowledged"
        if self.held:
            return "latched unacknowledged" if self.unacknowledged else "latched acknowledged"
        return "returned" if self.unacknowledged else "normal"


@given(st.booleans(), st.booleans(), st.lists(st.sampled_from(Operation), max_size=40))
def test_every_sequence_of_operations_leads_where_the_facts_lead(
    latch: bool, acknowledge: bool, operations: list[Operation]
) -> None:
    model, table, state = Model(latch, acknowledge), transitions(latch, acknowledge), S.NORMAL
    for operation in operations:
        model.happens(operation)
        state = table.get((state, operation), state)
        assert str(state) == model.state


@given(st.booleans(), st.booleans())
def test_every_state_but_normal_has_a_way_back(latch: bool, acknowledge: bool) -> None:
    table = transitions(latch, acknowledge)
    home = {S.NORMAL}
    for _ in S:
        home |= {at for (at, _), to in table.items() if to in home}
    reached = {S.NORMAL}
    for _ in S:
        reached |= {to for (at, _), to in table.items() if at in reached}
    assert reached <= home


def test_the_groups_of_states_fit_the_table() -> None:
    table = transitions(True, True) | transitions(False, True)
    assert {at for at, operation in table if operation is Operation.ACKNOWLEDGE} == TO_BE_ACKNOWLEDGED
    assert ANNUNCIATED | PUT_AWAY | {S.NORMAL} == set(S)
