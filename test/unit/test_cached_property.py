"""A cached property is computed once per instance, and instances do not wait for each other."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Barrier

from piezo_hysteresis.common.cached_property import cached_property


@dataclass(frozen=True)
class Record:
    """Record whose result waits until the result of another record is being computed."""

    barrier: Barrier
    calls: list[int]

    @cached_property
    def result(self) -> int:
        """Wait for the other record."""
        self.calls.append(1)
        return self.barrier.wait(timeout=10.0)


def test_is_computed_once_per_instance() -> None:
    record = Record(Barrier(1), [])
    assert record.result == record.result == 0
    assert len(record.calls) == 1


def test_two_instances_are_computed_in_parallel() -> None:
    barrier = Barrier(2)
    records = [Record(barrier, []), Record(barrier, [])]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda each: each.result, records))
    assert sorted(found) == [0, 1]


def test_has_the_documentation_of_its_function() -> None:
    assert Record.result.__doc__ == 'Wait for the other record.'
