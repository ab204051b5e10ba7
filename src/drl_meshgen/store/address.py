"""Addresses of artifacts on the file server: what pages link to and what the server understands."""

import os

from drl_meshgen.store.ref import ArtifactRef, checked_digest, checked_output, checked_stage

ENVIRONMENT = "DRL_MESHGEN_FILES"
"""Name of the environment variable with the base address of the file server, such as `http://127.0.0.1:4300`."""
ROOT = "artifacts"


def artifact_path(ref: ArtifactRef, output: str = "") -> str:
    """Return the path of an output file below the server's base address, of the list of all where none is named.

    Raises KeyError where the artifact has no such output.
    """
    if output and output not in ref.outputs:
        raise KeyError(output)
    return f"/{ROOT}/{ref.stage}/{ref.key}/{output}"


def artifact_url(ref: ArtifactRef, output: str = "") -> str | None:
    """Return the whole address that DRL_MESHGEN_FILES makes of `artifact_path`; None where that is not set."""
    base = os.environ.get(ENVIRONMENT, "").rstrip("/")
    return base + artifact_path(ref, output) if base else None


def parsed_path(path: str) -> tuple[str, str, str] | None:
    """Return stage, key and output ("" for the list of all) that `artifact_path` made a path of; None for others.

    Nothing is decoded: the names of a store need no escapes, so whatever has any is none of its addresses.
    """
    parts = path.split("/", 4)
    if len(parts) != 5 or parts[:2] != ["", ROOT]:
        return None
    try:
        stage, key = checked_stage(parts[2]), checked_digest(parts[3])
        return stage, key, checked_output(parts[4]) if parts[4] else ""
    except ValueError:
        return None
