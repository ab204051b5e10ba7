"""Prefect's view of the artifact store: a cached result is a record whose objects were all checked."""

from pathlib import Path

from prefect.filesystems import WritableFileSystem
from prefect.results import ResultRecord, ResultRecordMetadata
from prefect.serializers import JSONSerializer

from drl_meshgen.store import Store


class RecordStorage(WritableFileSystem):
    """Result storage that reads the store's own records, so there is one truth about what was computed.

    A storage key is the path of a record. Prefect takes an error on reading for "not cached", so a record that is
    absent or names a damaged object makes the task run.
    """

    _block_type_name = "drl-meshgen records"

    def _resolve_path(self, path: str) -> None:
        """Tell Prefect that keys are whole already."""

    def read_path(self, path: str, *, _sync: bool = True) -> bytes:
        """Return Prefect's form of the record at `path`; raises FileNotFoundError where the store has no sound one."""
        record = Path(path)
        ref = Store(record.parents[2]).find(record.parent.name, record.stem)
        if ref is None:
            raise FileNotFoundError(path)
        metadata = ResultRecordMetadata(storage_key=path, serializer=JSONSerializer())
        return ResultRecord(metadata=metadata, result=ref.to_json()).serialize()

    async def aread_path(self, path: str) -> bytes:
        """Return the same as `read_path`."""
        return self.read_path(path)

    def write_path(self, path: str, content: bytes, *, _sync: bool = True) -> None:
        """Leave everything as it is: the task has written the record before it returned."""

    async def awrite_path(self, path: str, content: bytes) -> None:
        """Do the same as `write_path`."""
