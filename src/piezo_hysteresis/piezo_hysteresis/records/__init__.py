"""Input and output of records: bags, tables and metadata of an experiment (no physics)."""

from piezo_hysteresis.records.bag_writer import write_bag
from piezo_hysteresis.records.bags import read_bag
from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.damage import Damage, DamageWarning, LeftOutWarning
from piezo_hysteresis.records.load import Survey, listed, load, survey
from piezo_hysteresis.records.record import Record, RecordInfo, RecordList
from piezo_hysteresis.records.tabular import write_csv
from piezo_hysteresis.records.text_tables import read_csv

__all__ = [
    'Damage',
    'DamageWarning',
    'LeftOutWarning',
    'ReadOptions',
    'Record',
    'RecordInfo',
    'RecordList',
    'Survey',
    'listed',
    'load',
    'read_bag',
    'read_csv',
    'survey',
    'write_bag',
    'write_csv',
]
