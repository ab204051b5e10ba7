"""What the server does by itself: `python -m flows.automations` registers it, again and again with the same result.

A worker that dies with its machine cannot say that its runs have ended. Runs send heartbeats; where these stay away,
the server marks the run as crashed, and whoever waits for it goes on.
"""

from datetime import timedelta

from prefect.automations import Automation, EventTrigger
from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import StateType
from prefect.events.actions import ChangeFlowRunState
from prefect.events.schemas.automations import Posture
from prefect.settings import PREFECT_FLOWS_HEARTBEAT_FREQUENCY

from flows import run_command

BEAT = "prefect.flow-run.heartbeat"
TAKEN, BEGUN = "prefect.flow-run.Pending", "prefect.flow-run.Running"
"""What the server tells when a worker takes a run, and when its process has loaded the flow."""
ENDS = tuple(f"prefect.flow-run.{state}" for state in ("Completed", "Failed", "Cancelled", "Crashed"))
MISSED = 2.5
"""Heartbeats that may stay away (count)."""
STARTING = 4.0
"""How long a run may take to begin (heartbeats)."""


def lost_runs(beat: int) -> tuple[Automation, ...]:
    """Return the automations that end runs that never begin, and runs without heartbeats, one every `beat` seconds."""
    return (
        _ended("Runs whose worker died", {BEGUN, BEAT}, {BEAT, *ENDS}, MISSED * beat, "no heartbeat any more"),
        _ended("Runs that never began", {TAKEN}, {BEGUN, BEAT, *ENDS}, STARTING * beat, "the run never began"),
    )


def _ended(name: str, after: set[str], expected: set[str], seconds: float, told: str) -> Automation:
    """Return the automation that marks a run as crashed where nothing expected follows an event within some time."""
    return Automation(
        name=name,
        description=f"Marks a run as crashed after {seconds:g} seconds: {told}.",
        trigger=EventTrigger(
            after=after,
            expect=expected,
            match={"prefect.resource.id": "prefect.flow-run.*"},
            for_each={"prefect.resource.id"},
            posture=Posture.Proactive,
            threshold=1,
            within=timedelta(seconds=seconds),
        ),
        actions=[ChangeFlowRunState(state=StateType.CRASHED, message=f"its worker died: {told}")],
    )


def register() -> None:
    """Register all automations at the server; those of the same name are replaced."""
    for wanted in lost_runs(PREFECT_FLOWS_HEARTBEAT_FREQUENCY.value() or 30):
        with get_client(sync_client=True) as client:
            for known in client.read_automations_by_name(wanted.name):
                client.delete_automation(known.id)
        wanted.create()


if __name__ == "__main__":
    run_command(register)
