"""Identify or discover over many bags: any executor, resumed after a kill, one table."""

from piezo_hysteresis.batch.run import Batch, run_batch
from piezo_hysteresis.batch.tasks import Discover, Identify, Task

__all__ = ['Batch', 'Discover', 'Identify', 'Task', 'run_batch']
