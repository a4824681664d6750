"""``metadata.yaml`` of a bag, version 9 as Jazzy writes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.storage import Topic

NAME = 'metadata.yaml'
ROOT = 'rosbag2_bagfile_information'
SUFFIXES = {'mcap': '.mcap', 'sqlite3': '.db3'}


@dataclass
class FileSummary:
    """What a storage file holds: its name, log times [ns] and number of messages."""

    name: str
    first: int = (1 << 63) - 1
    last: int = 0
    count: int = 0


@dataclass
class Metadata:
    """Metadata of a bag."""

    storage: str  # ``mcap`` or ``sqlite3``
    files: list[FileSummary] = field(default_factory=list)  # storage files in order
    topics: dict[str, tuple[Topic, int]] = field(default_factory=dict)
    custom: dict[str, str] = field(default_factory=dict)  # free entries
    compression: str = ''  # empty, ``file`` or ``message``

    def content(self) -> dict[str, Any]:
        """Return what stands below the root of ``metadata.yaml``."""
        filled = [file for file in self.files if file.count]
        first = min((file.first for file in filled), default=0)
        last = max((file.last for file in filled), default=0)
        return {
            'version': 9,
            'storage_identifier': self.storage,
            'duration': {'nanoseconds': last - first},
            'starting_time': {'nanoseconds_since_epoch': first},
            'message_count': sum(file.count for file in self.files),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.msgtype,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': plain_yaml.load(topic.qos) or [],
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': count,
                }
                for topic, count in self.topics.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [file.name for file in self.files],
            'files': [
                {
                    'path': file.name,
                    'starting_time': {'nanoseconds_since_epoch': file.first if file.count else 0},
                    'duration': {'nanoseconds': file.last - file.first if file.count else 0},
                    'message_count': file.count,
                }
                for file in self.files
            ],
            'custom_data': self.custom or None,
            'ros_distro': 'jazzy',
        }

    def text(self) -> str:
        """Return the content as YAML, as storage files repeat it."""
        return str(yaml.safe_dump(self.content(), sort_keys=False))

    def write(self, folder: Path) -> None:
        """Write ``metadata.yaml`` into `folder`, atomically replacing an older one."""
        with write_atomically(folder / NAME) as temporary:
            temporary.write_text(yaml.safe_dump({ROOT: self.content()}, sort_keys=False), 'utf-8')


def read_metadata(folder: Path, log: DamageLog) -> Metadata:
    """Return the metadata of a bag folder.

    If ``metadata.yaml`` is missing or unreadable and the log salvages, the storage files of the
    folder are listed instead.
    """
    path = folder / NAME
    if not path.is_file():
        log.at(folder).add(f'{NAME} is missing', remedy='run `ros2 bag reindex` on the folder')
        return _from_files(folder)
    try:
        return _parse(plain_yaml.load_file(path)[ROOT])
    except OSError as error:
        reason = reason_of(error)
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        reason = str(error).split('\n', 1)[0]
    except (KeyError, TypeError, AttributeError, IndexError):
        reason = 'an entry is missing or of the wrong kind'
    log.at(path).add(
        f'it cannot be read ({reason})', remedy='run `ros2 bag reindex` on the folder'
    )
    return _from_files(folder)


def _from_files(folder: Path) -> Metadata:
    for storage, suffix in SUFFIXES.items():
        names = sorted(path.name for path in folder.glob(f'*{suffix}'))
        if names:
            return Metadata(storage, [FileSummary(name, count=-1) for name in names])
    return Metadata('mcap')


def _parse(content: dict[str, Any]) -> Metadata:
    counts = {entry['path']: entry for entry in content.get('files') or []}
    files = []
    for name in content['relative_file_paths']:
        entry = counts.get(name, {})
        files.append(FileSummary(Path(name).name, count=int(entry.get('message_count', -1))))
    topics = {}
    for entry in content['topics_with_message_count']:
        about = entry['topic_metadata']
        topic = Topic(
            str(about['name']),
            str(about['type']),
            type_hash=about.get('type_description_hash', ''),
        )
        topics[topic.name] = (topic, int(entry['message_count']))
    custom = content.get('custom_data') or {}
    if not isinstance(custom, dict):
        raise ValueError('custom_data is no map')
    return Metadata(
        str(content['storage_identifier']),
        files,
        topics,
        {str(key): str(value) for key, value in custom.items()},
        str(content.get('compression_mode') or '').lower().replace('none', ''),
    )
