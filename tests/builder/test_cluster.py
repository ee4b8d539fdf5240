"""A rebuild on a Ray cluster of two nodes on the loopback address, of which one is killed."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.builder.folders import contents
from tests.waiting import until
from xden1k.errors import DataError
from xden_builder.capture import CaptureFolder
from xden_builder.phantoms import write_captures
from xden_builder.phantoms.scanner import Scanner
from xden_builder.pipeline.beam import BEAM_NAME
from xden_builder.pipeline.cluster import RETRIES, run_on_cluster
from xden_builder.pipeline.run import build, work_folder
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.workers import WorkerDiedError

pytestmark = pytest.mark.skipif(
    find_spec("ray") is None, reason="Ray is not installed: pip install 'xden1k[cluster]'"
)
NODE = {"num_cpus": 1, "node_ip_address": "127.0.0.1", "object_store_memory": 80 << 20}


@pytest.fixture(scope="module")
def cluster():
    """A Ray cluster of one node, to which a test adds others; nothing leaves the machine."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="ray") as short:
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        patch.setenv("RAY_TMPDIR", short)  # its sockets allow no long path
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")  # else 127.0.0.1 is translated
        from ray.cluster_utils import Cluster

        nodes = Cluster(initialize_head=True, head_node_args={"include_dashboard": False, **NODE})
        yield nodes
        nodes.shutdown()


@pytest.fixture
def second_node(cluster):
    """A node that is killed in the test."""
    node = cluster.add_node(**NODE)
    yield node
    if node in cluster.worker_nodes:
        cluster.remove_node(node, allow_graceful=False)


@pytest.fixture(scope="module")
def captures(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("captures") / "captures"
    write_captures(root, 8, 3, size=64, ideal=True)
    return root


@pytest.fixture(scope="module")
def built(captures) -> Path:
    """What one machine makes of them."""
    out = captures.with_name("dataset")
    build(captures, out, BuildSettings(), workers=2)
    return out


@pytest.mark.slow
def test_what_a_lost_node_was_working_on_is_done_on_another(cluster, second_node, tmp_path):
    doomed = second_node.node_id

    def begun_there():
        return [key.name for key in tmp_path.iterdir() if doomed in key.read_text().split()]

    def endless_on_the_doomed_node(key):
        import ray

        node = ray.get_runtime_context().get_node_id()
        with (tmp_path / key).open("a") as file:
            file.write(f"{node}\n")
        while node == doomed or not begun_there():
            time.sleep(0.1)
        return key.upper()

    with closing(
        run_on_cluster(endless_on_the_doomed_node, iter("abcdefgh"), cluster.address)
    ) as answers:
        first = next(answers)
        cluster.remove_node(second_node, allow_graceful=False)
        assert sorted([first, *answers]) == [(key, key.upper()) for key in "abcdefgh"]
    begun_again = [key.name for key in tmp_path.iterdir() if len(key.read_text().split()) == 2]
    assert begun_again == begun_there() != []


@pytest.mark.slow
def test_an_object_that_raises_or_kills_its_process_is_an_answer_like_others(cluster, tmp_path):
    def fragile(key):
        if key == "raises":
            raise DataError("no such part")
        if key == "kills":
            with (tmp_path / key).open("a") as file:
                file.write("x")
            os.kill(os.getpid(), signal.SIGKILL)
        return key

    answers = dict(run_on_cluster(fragile, ["raises", "kills", "fine"], cluster.address))
    assert answers["fine"] == "fine"
    assert isinstance(answers["raises"], DataError)
    assert str(answers["raises"]) == "no such part"
    assert isinstance(answers["kills"], WorkerDiedError)
    assert "\n" not in str(answers["kills"])
    assert (tmp_path / "kills").read_text() == "x" * (RETRIES + 1)


@pytest.mark.slow
@pytest.mark.parametrize("as_urls", [False, True], ids=["shared_paths", "urls"])
def test_a_rebuild_that_loses_a_node_gives_the_local_builds_bytes(
    cluster, second_node, captures, built, tmp_path, as_urls
):
    out = tmp_path / "dataset"
    places = [f"file://{captures}", f"file://{out}"] if as_urls else [captures, "dataset"]
    command = [Path(sys.executable).with_name("xden-build"), "run", places[0], "--out", places[1]]
    with subprocess.Popen(  # noqa: S603
        [*command, "--cluster", cluster.address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,  # the workers have another
    ) as driver:
        work = work_folder(out)
        until(lambda: driver.poll() is not None or len(list(work.glob("*.seal"))) >= 2)
        cluster.remove_node(second_node, allow_graceful=False)
        stdout, stderr = driver.communicate()
    assert driver.returncode == 0, stderr
    assert "8 built, 0 kept, 0 failed" in stdout.splitlines()[-1]
    assert contents(out) == contents(built)
    names = {path.name for path in work_folder(out).glob("*.h5")}
    assert names == {f"{object_id}.h5" for object_id in CaptureFolder(captures).object_ids}


@pytest.mark.slow
def test_a_node_lost_while_the_filter_of_the_folder_is_sought_changes_no_byte(
    cluster, second_node, tmp_path
):
    captures, local, out = (tmp_path / name for name in ("captures", "local", "dataset"))
    write_captures(captures, 6, 3, size=64, scanner=Scanner.realistic())
    build(captures, local, BuildSettings(), workers=2)
    command = [Path(sys.executable).with_name("xden-build"), "run", captures, "--out", out]
    with subprocess.Popen(  # noqa: S603
        [*command, "--cluster", cluster.address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as driver:
        until(lambda: driver.poll() is not None or work_folder(out).is_dir())
        sought = not (work_folder(out) / BEAM_NAME).exists()
        cluster.remove_node(second_node, allow_graceful=False)
        _, stderr = driver.communicate()
    assert driver.returncode == 0, stderr
    assert sought
    found, wanted = (work_folder(each) / BEAM_NAME for each in (out, local))
    assert found.read_bytes() == wanted.read_bytes()
    assert contents(out) == contents(local)


def test_an_address_where_nobody_listens_is_one_line():
    with pytest.raises(DataError, match=r"^127\.0\.0\.1:1: no Ray cluster answers"):
        next(run_on_cluster(str, ["a"], "127.0.0.1:1"))
