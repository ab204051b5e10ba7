"""What a server knows of the task runs of a flow."""

from prefect.client.orchestration import get_client
from prefect.settings import PREFECT_API_URL, temporary_settings


def latest(api):
    """Return the task runs of the latest flow run."""
    with temporary_settings({PREFECT_API_URL: api}), get_client(sync_client=True) as client:
        newest = max(client.read_flow_runs(), key=lambda run: run.created)
        return [run for run in client.read_task_runs() if run.flow_run_id == newest.id]


def states(api):
    """Return their states by their names."""
    return {run.name: run.state_name for run in latest(api)}


def parents(api):
    """Return, by their names, the names of those that each was given a result of."""
    runs = latest(api)
    names = {run.id: run.name for run in runs}
    return {run.name: {names[i.id] for given in run.task_inputs.values() for i in given} for run in runs}
