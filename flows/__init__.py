"""Prefect flows; importable from the repository root only. Quiet and offline unless the environment says otherwise."""

import os

os.environ.setdefault("DO_NOT_TRACK", "1")
os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
