"""Records from bags of other message types, by naming the fields that mean something."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import blocks_of
from piezo_hysteresis.records.columns import UNITS
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import store_of, typestore
from piezo_hysteresis.records.record import Record, RecordInfo
from piezo_hysteresis.records.sampling import Track, records_of
from piezo_hysteresis.records.storage import Topic

EXAMPLE = '/topic.field or /topic.field:unit'
CLOCK = 2e8  # stamps of one clock differ by less from the recording [ns]


@dataclass(frozen=True)
class Signal:
    """A field of the messages of a topic, with its divisor for SI units."""

    topic: str
    field: tuple[str, ...]
    divisor: float


#: Times [ns] and values of one signal in order of time, each of shape (n,).
Series = tuple[IntArray, FloatArray]


def parse_signal(text: str, quantity: str) -> Signal:
    """Parse a field such as ``/laser/position.point.x:um`` or ``/adc.data[2]:V``.

    ``/joint_states.position[stage]`` selects the element by the ``name`` list of the message.
    """
    name, _, unit = text.partition(':')
    topic, dot, path = name.partition('.')
    units = UNITS[quantity]
    if not dot or not re.fullmatch(r'\w+(\[\w+\])*(\.\w+(\[\w+\])*)*', path):
        raise RecordError(f'the {quantity} {text!r} is not understood; write {EXAMPLE}')
    if unit and unit not in units:
        raise RecordError(f'the {quantity} {text!r} has no unit of {", ".join(units)}; name one')
    steps = tuple(re.findall(r'\w+', path))
    return Signal('/' + topic.strip('/'), steps, units[unit] if unit else 1.0)


def foreign_records(
    path: str | Path,
    log: DamageLog,
    *,
    voltage: str | None = None,
    displacement: str,
    reference: str | None = None,
    force: str | None = None,
    time_from: str = '',
) -> list[Record]:
    """Read a bag of any message types as a record (as its intact parts when salvaging).

    Every displacement is a sample; voltage and reference hold until their next message. The time
    is that of the header, if all messages have one and their clocks agree; else of the recording.
    """
    path = Path(path)
    log = log.at(path)
    if (voltage is None) == (force is None):
        raise RecordError('the input is a voltage or a force: name one of them')
    texts = {'voltage': voltage, 'force': force, 'displacement': displacement,
             'reference': reference}  # fmt: skip
    named = {key: parse_signal(text, key) for key, text in texts.items() if text is not None}
    signals = {'voltage' if key == 'force' else key: signal for key, signal in named.items()}
    series = _read(path, signals, log, time_from)
    ticks, moved = series['displacement']
    begin = ticks[0]
    first = max(times[0] for times, _ in series.values())
    early = int(np.sum(ticks < first))
    if early:
        what = f'{counted(early, "sample", "comes")} before the first voltage or reference'
        log.note(what, count=early)
    ticks = ticks[ticks >= first]
    columns = {
        key: values[np.searchsorted(times, ticks, side='right') - 1]
        for key, (times, values) in series.items()
    }
    columns['displacement'] = moved[early:]
    time = np.asarray((ticks - begin) / 1e9, np.float64)
    info = RecordInfo(input_unit='N' if force else 'V')
    return records_of(Track(path.resolve().stem, time, columns, info=info), log)


def _read(
    path: Path, signals: dict[str, Signal], log: DamageLog, time_from: str
) -> dict[str, Series]:
    recorded: dict[str, list[int]] = {key: [] for key in signals}
    stamped: dict[str, list[int | None]] = {key: [] for key in signals}
    values: dict[str, list[float]] = {key: [] for key in signals}
    seen: set[str] = set()
    for topics, block in blocks_of(path, log):
        seen |= {topic.name for topic in topics.values()}
        for key, signal in signals.items():
            numbers = [
                k for k, topic in topics.items() if '/' + topic.name.strip('/') == signal.topic
            ]
            for index in np.flatnonzero(np.isin(block.topic, numbers)).tolist():
                topic = topics[int(block.topic[index])]
                message = _decode(topic, block.payload(index), path)
                values[key].append(_value(message, signal, topic) / signal.divisor)
                recorded[key].append(int(block.log_time[index]))
                stamped[key].append(_stamp(message))
    for key, signal in signals.items():
        if not values[key]:
            held = ', '.join(sorted(seen)[:6]) or 'none'
            raise RecordError(f'{path}: it holds nothing of topic {signal.topic}, but {held}')
    logged = {key: np.array(times, np.int64) for key, times in recorded.items()}
    headers = {
        key: None if None in stamps else np.array(stamps, np.int64)
        for key, stamps in stamped.items()
    }
    topics_of = {key: signal.topic for key, signal in signals.items()}
    times = _times(path, topics_of, logged, headers, log, time_from)
    result = {}
    for key, column in values.items():
        # Messages on their way are overtaken; each signal by itself is what its sender stamped.
        order = np.argsort(times[key], kind='stable')
        result[key] = times[key][order], np.array(column)[order]
    return result


def _times(
    path: Path,
    topics: dict[str, str],
    logged: dict[str, IntArray],
    headers: dict[str, IntArray | None],
    log: DamageLog,
    time_from: str,
) -> dict[str, IntArray]:
    """Return the times of each signal [ns], all of one clock; refuse what is ambiguous."""
    if time_from == 'recording':
        return logged
    bare = sorted({topics[key] for key, stamps in headers.items() if stamps is None})
    if time_from == 'header':
        if bare:
            raise RecordError(f'{path}: the messages of {", ".join(bare)} have no header stamp; '
                              'take --time-from recording')  # fmt: skip
        return {key: stamps for key, stamps in headers.items() if stamps is not None}
    stamped = {key: stamps for key, stamps in headers.items() if stamps is not None}
    constant = [topics[key] for key, stamps in stamped.items()
                if stamps.size > 2 and np.all(stamps == stamps[0])]  # fmt: skip
    ahead = {key: float(np.median(stamps - logged[key])) for key, stamps in stamped.items()}
    # without a header the recording is the only clock
    offsets = {**dict.fromkeys(logged, 0.0), **ahead}
    apart = max(offsets.values()) - min(offsets.values())
    if constant:
        log.guess(f'the header stamps of {", ".join(sorted(set(constant)))} are all the '
                  'same: the times are those of the recording')  # fmt: skip
        return logged
    if apart <= CLOCK:
        return {key: headers.get(key) if headers[key] is not None else logged[key]  # type: ignore[misc]
                for key in logged}  # fmt: skip
    named = ', '.join(sorted({topics[key] for key in ahead}))
    if bare:
        log.guess(f'the header stamps of {named} are of another clock than the recording, '
                  f'{apart / 1e9:.6g} s apart: the times are those of the recording '
                  '(--time-from recording states it)')  # fmt: skip
        return logged
    raise RecordError(
        f'{path}: the header stamps of {named} are of two clocks, {apart / 1e9:.6g} s apart; '
        'state which time counts with --time-from recording or --time-from header'
    )


def _decode(topic: Topic, payload: bytes, path: Path) -> Any:
    from rosbags.serde import SerdeError

    if not topic.definition and topic.msgtype not in typestore().fielddefs:
        raise RecordError(
            f'{path}: it holds no definition of {topic.msgtype} (sqlite3 bags hold none); '
            'convert it to mcap with `ros2 bag convert` where the type is installed'
        )
    try:
        store = store_of(topic) if topic.definition else typestore()
        return store.deserialize_cdr(payload, topic.msgtype)
    except (SerdeError, KeyError, ValueError, IndexError, AssertionError, struct.error) as error:
        raise RecordError(
            f'{path}: a message of {topic.name} ({topic.msgtype}) cannot be read ({error!r})'
        ) from None


def _value(message: Any, signal: Signal, topic: Topic) -> float:
    value = message
    try:
        for step in signal.field:
            value = _step(value, step, message)
        return float(value)
    except (AttributeError, IndexError, TypeError, ValueError):
        held = ', '.join(name for name in vars(message) if not name.startswith('_'))
        raise RecordError(
            f'topic {topic.name} has no number {".".join(signal.field)}; '
            f'{topic.msgtype} has {held}'
        ) from None


def _step(value: Any, step: str, message: Any) -> Any:
    """Return a field, an element, or the element that the message's ``name`` list names."""
    if step.isdigit():
        return value[int(step)]
    names = [] if hasattr(value, step) else list(getattr(message, 'name', ()))
    return value[names.index(step)] if step in names else getattr(value, step)


def _stamp(message: Any) -> int | None:
    """Return the stamp of the header [ns]; None without a header."""
    stamp = getattr(getattr(message, 'header', None), 'stamp', None)
    return None if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
