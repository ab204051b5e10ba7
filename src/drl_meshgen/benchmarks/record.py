"""What a long run has measured so far, line by line in a file, so that an interrupted run goes on where it was."""

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


class Record:
    """Rows by key in a JSON-lines file. A row counts only for the code it was measured with."""

    def __init__(self, path: Path, code: str, *, resume: bool) -> None:
        """Open the file; without `resume` what it holds is dropped."""
        self.path, self.code = path, code
        self.rows: dict[str, Row] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        if not resume:
            path.unlink(missing_ok=True)
        elif path.exists():
            self._read()

    def _read(self) -> None:
        whole = self.path.read_text("utf-8").rpartition("\n")[0]  # a line cut short by the interruption is no line
        self.path.write_text(whole + "\n" if whole else "", "utf-8")
        for line in whole.splitlines():
            entry = json.loads(line)
            if entry["code"] == self.code:
                self.rows[entry["key"]] = entry["row"]

    def add(self, key: str, row: Row) -> None:
        """Append a row; it is on disk when this returns."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "code": self.code, "row": row}) + "\n")
        self.rows[key] = row
