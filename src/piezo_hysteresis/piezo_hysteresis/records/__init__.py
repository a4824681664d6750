"""Records in and out: bags, CSV and what is known of an experiment (neutral: no physics)."""

from piezo_hysteresis.records.record import Record, RecordInfo

__all__ = ['Record', 'RecordInfo']
