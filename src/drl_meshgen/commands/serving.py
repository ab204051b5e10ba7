"""The `store serve` command: a file server from start to signal."""

import signal
import threading

import typer

from drl_meshgen.errors import FINE, InputError
from drl_meshgen.store import Store
from drl_meshgen.store.serve import ArtifactServer


def serve(store: Store, host: str, port: int) -> int:
    """Serve a store until SIGTERM or SIGINT; raises `InputError` where the address cannot be had."""
    try:
        server = ArtifactServer(store, host, port)
    except OSError as error:
        defect = f"cannot listen there, {error.strerror or error}"
        raise InputError(f"{host}:{port}", defect, "choose another address with --host and --port") from None

    def leave(_signal: int, _frame: object) -> None:
        threading.Thread(target=server.shutdown).start()  # it waits for the loop below, which this interrupts

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, leave)
    with server:
        typer.echo(f"serving {store.root} at {server.url}")
        if not server.local:
            typer.echo("warning: whoever reaches this address can read all artifacts", err=True)
        server.serve_forever(poll_interval=0.1)
    return FINE
