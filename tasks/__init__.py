"""Prefect tasks, one module per stage; importable from the repository root only."""
