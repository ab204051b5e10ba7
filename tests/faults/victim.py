"""A process that runs the pipeline in children of its own, which kill themselves where they are told to.

Each line on standard input is a JSON object: `store`, `stage` (run up to it), `point` (one of `POINTS`; null: to the
end), `count` (children at once), `log` (a file that gets the name of every stage that is computed). After each line the
signals that ended the children are printed as JSON, 0 for one that came to its end.
"""

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drl_meshgen.baselines import RivalOptions
from drl_meshgen.pipeline import COMPARED_STAGES, MeshOptions
from drl_meshgen.store import Store, execute, objects

POINTS = ("half", "written", "unnamed", "between", "unrecorded", "recorded")
"""Amid a file of the outputs, with all written, before the first object has its name, between two objects, with all
objects and no record, with the record."""
OPTIONS = MeshOptions(comparison=RivalOptions(("transfinite",))).sized(100)


def end_here(*_arguments: Any) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def after(function: Callable[..., Any]) -> Callable[..., Any]:
    def killed(*arguments: Any) -> None:
        function(*arguments)
        end_here()

    return killed


def armed(point: str) -> None:
    """Let this process kill itself at a point of the next artifact that is stored."""
    if point == "unnamed":
        objects.settle = end_here
    elif point == "between":
        objects.Objects.put = after(objects.Objects.put)
    elif point == "unrecorded":
        Store._keep = end_here
    elif point == "recorded":
        Store._keep = after(Store._keep)


def traced(stage: str, point: str | None, log: Path) -> None:
    """Note every computation in the log, and kill this process in that of a stage."""
    run = Store.run

    def noted(self: Store, recipe: Any, compute: Callable[[Path], Any], made: Any = None) -> Any:
        def told(folder: Path) -> Any:
            with log.open("a") as lines:
                lines.write(f"{recipe.stage}\n")
            parts = compute(folder)
            if recipe.stage == stage and point is not None:
                if point == "half":
                    first = min(path for path in folder.rglob("*") if path.is_file())
                    os.truncate(first, first.stat().st_size // 2)
                if point in ("half", "written"):
                    end_here()
                armed(point)
            return parts

        return run(self, recipe, told, made)

    Store.run = noted


def work(store: str, stage: str, point: str | None, log: str) -> None:
    traced(stage, point, Path(log))
    options = OPTIONS.by_stage("hemisphere", 5000, compare=True)
    execute(COMPARED_STAGES, options, store=Store(store), targets=[stage])


def main() -> None:
    execute(COMPARED_STAGES, OPTIONS.by_stage("hemisphere", 5000, compare=True), targets=["quality"])
    for line in sys.stdin:
        task = json.loads(line)
        count = task.pop("count", 1)
        children = []
        for _ in range(count):
            child = os.fork()
            if child == 0:
                try:
                    work(**task)
                finally:
                    sys.stdout.flush()
                    os._exit(0 if sys.exc_info()[0] is None else 1)
            children.append(child)
        ended = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
        sys.stdout.write(json.dumps(ended) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
