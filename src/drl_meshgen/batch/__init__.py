"""Many models at once: which ones, with which options, what came of each, and what is still to do."""

from drl_meshgen.batch.jobs import Job, collect
from drl_meshgen.batch.rows import TABLE, Row, Rows, Status, keys_of
from drl_meshgen.batch.watch import Watch

__all__ = ["TABLE", "Job", "Row", "Rows", "Status", "Watch", "collect", "keys_of"]
