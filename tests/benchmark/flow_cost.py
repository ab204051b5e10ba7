"""What flow and commands cost beside the meshing itself: `python -m tests.benchmark.flow_cost`.

Least of several runs, by the clock and in CPU seconds of the process (the server's are not among them). The overhead is
what a run takes beyond the seconds that its stages report; every run of it has a store of its own.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from drl_meshgen.pipeline import MeshOptions, run
from drl_meshgen.store import Store
from drl_meshgen.store.catalogue import Catalogue
from flows.mesh import mesh
from flows.server import connected

TIMES = 5
MODELS = ["hemisphere", "giraffe", "hand"]
QUADS = 8000


def spent(store):
    """Return the seconds that all artifacts of a store took."""
    return sum(record.seconds for record in Catalogue.of(store).records)


def overhead(work):
    """Return what a run of one small model takes beyond its stages: seconds by the clock, the only ones stages tell."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        work(folder)
        clock = time.perf_counter() - start
        return (clock - spent(Store(folder)),)


def by_library(folder):
    run("hemisphere", MeshOptions().sized(300), triangles=5000, store=Store(folder))


def by_flow(folder):
    mesh(["hemisphere"], target_quads=300, triangles=5000, store=folder, compare=False, return_state=True)


def warm(report):
    """Mesh the three models in this process, all of it cached; return seconds by the clock and CPU seconds."""
    clock, cpu = time.perf_counter(), time.process_time()
    mesh(MODELS, target_quads=QUADS, compare=False, report=report, return_state=True)
    return time.perf_counter() - clock, time.process_time() - cpu


def command(*arguments):
    """Run a command; return seconds by the clock and CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    subprocess.run(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    clock = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def first_sign(*arguments):
    """Run a command at a terminal; return seconds and CPU seconds until it shows anything."""
    ours, theirs = os.openpty()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    process = subprocess.Popen(arguments, stdin=theirs, stdout=theirs, stderr=theirs)
    os.read(ours, 1)
    clock = time.perf_counter() - start
    process.kill()
    process.wait()
    os.close(ours)
    os.close(theirs)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def least(measure, times=TIMES):
    return tuple(min(column) for column in zip(*(measure() for _ in range(times)), strict=True))


def show(name, figures):
    cpu = "".join(f"  {seconds:6.2f} s CPU" for seconds in figures[1:])
    sys.stdout.write(f"{name:<50} {figures[0]:6.2f} s{cpu}\n")
    sys.stdout.flush()


def main():
    tool = str(Path(sys.executable).parent / "drl-meshgen")
    flow = [sys.executable, "-m", "flows.mesh", *MODELS, "--target-quads", str(QUADS), "--no-compare"]
    domain = Path(tempfile.mkdtemp()) / "square.csv"
    side = [(k / 8, 0.0) for k in range(8)]
    points = [*side, *((1.0, x) for x, _ in side), *((1 - x, 1.0) for x, _ in side), *((0.0, 1 - x) for x, _ in side)]
    domain.write_text("x,y\n" + "\n".join(f"{x},{y}" for x, y in points))
    out = str(domain.parent)
    with connected() as api:
        os.environ["PREFECT_API_URL"] = api
        for work in (by_library, by_flow):
            overhead(work)  # compiles
        show("library call, beyond its stages", least(lambda: overhead(by_library)))
        show("flow, beyond its stages and the report", least(lambda: overhead(by_flow)))
        report = ["--report", f"{out}/report"]
        command(*flow, *report)  # computes what the store lacks
        show("warm run of three models, the first in a process", warm(report[1]))
        show("warm run of three models, in one process", least(lambda: warm(report[1])))
        show("warm run of three models, as a command", least(lambda: command(*flow, *report)))
    show("python -m flows.mesh, to the first sign", least(lambda: first_sign(*flow)))
    show("drl-meshgen --help", least(lambda: command(tool, "--help")))
    show("drl-meshgen store ls", least(lambda: command(tool, "store", "ls")))
    plan = ("store", "plan", "hand", "--target-quads", str(QUADS))
    show("drl-meshgen store plan, first sign", least(lambda: first_sign(tool, *plan)))
    show("drl-meshgen store plan, whole", least(lambda: command(tool, *plan)))
    fill = ("fill", str(domain), "--out", out, "--no-pictures")
    show("drl-meshgen fill, first sign", least(lambda: first_sign(tool, *fill)))
    show("drl-meshgen fill, whole", least(lambda: command(tool, *fill)))
    small = ("mesh", "hemisphere", "--target-quads", "300", "--no-pictures", "--out", out)
    show("drl-meshgen mesh hemisphere, first sign", least(lambda: first_sign(tool, *small)))


if __name__ == "__main__":
    main()
