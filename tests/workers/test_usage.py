"""What a dispatcher says about its own need of processors and memory."""

import subprocess
import sys
import time

from tests.workers.fake import run_fake
from tests.workers.jobs import worker_info
from tests.workers.test_dispatcher import ListSource
from workers.dispatcher import Dispatcher
from workers.executor import Inline
from workers.process_tree import Usage


def test_nothing_is_told_before_it_was_measured():
    assert Usage(kept_s=60.0).read() is None


def test_processor_time_and_memory_are_those_of_the_whole_process_tree():
    usage = Usage(kept_s=0.2)
    busy = "import time\nend = time.process_time() + 0.3\nwhile time.process_time() < end: pass\ninput()"
    with subprocess.Popen([sys.executable, "-c", busy], stdin=subprocess.PIPE) as child:
        spent, end, need = 0.0, time.monotonic() + 30.0, None
        while spent < 0.25 and time.monotonic() < end:
            begin = time.monotonic()
            time.sleep(0.25)
            need = usage.read()
            spent += need["cpu_cores"] * (time.monotonic() - begin)
        child.communicate(b"\n")
    # 0.3 s less the tick of the clock, and the seconds are ours only to the length of a sleep.
    assert spent >= 0.25
    assert 0 < need["memory_bytes"] < need["host_memory_bytes"]


class RememberingSource(ListSource):
    def claim(self, request):
        self.worker = request.worker
        return super().claim(request)


def test_a_claim_tells_the_need_and_the_slots_of_now():
    source, usage = RememberingSource(1), Usage(kept_s=0.0)
    Dispatcher(source, Inline(run_fake), worker_info(), usage=usage).step()
    assert source.worker.memory_bytes > 1e6 and source.worker.cpu_cores >= 0.0
    assert source.worker.slots == 1
