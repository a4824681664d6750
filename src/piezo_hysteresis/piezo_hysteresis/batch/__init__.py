"""Identify or discover over many data sets: any executor, resumed after a kill, one table."""

from piezo_hysteresis.batch.run import Batch, run_batch

__all__ = ['Batch', 'run_batch']
