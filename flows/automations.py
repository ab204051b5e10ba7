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

BEAT = "prefect.flow-run.heartbeat"
ENDS = tuple(f"prefect.flow-run.{state}" for state in ("Completed", "Failed", "Cancelled", "Crashed"))
MISSED = 2.5
"""Heartbeats that may stay away (count)."""


def lost_runs(beat: int) -> Automation:
    """Return the automation that ends runs without heartbeats, which come every `beat` seconds."""
    return Automation(
        name="Runs whose worker died",
        description="Marks a run as crashed whose heartbeats stay away.",
        trigger=EventTrigger(
            after={BEAT},
            expect={BEAT, *ENDS},
            match={"prefect.resource.id": "prefect.flow-run.*"},
            for_each={"prefect.resource.id"},
            posture=Posture.Proactive,
            threshold=1,
            within=timedelta(seconds=MISSED * beat),
        ),
        actions=[ChangeFlowRunState(state=StateType.CRASHED, message="its worker died: no heartbeat any more")],
    )


def register() -> None:
    """Register all automations at the server; those of the same name are replaced."""
    wanted = lost_runs(PREFECT_FLOWS_HEARTBEAT_FREQUENCY.value() or 30)
    with get_client(sync_client=True) as client:
        for known in client.read_automations_by_name(wanted.name):
            client.delete_automation(known.id)
    wanted.create()


if __name__ == "__main__":
    register()
