"""Bags that users bring, whole and damaged, raw and packed; the next report is a row."""

import re
import shutil

import pytest

from gcl_core.compact.scan import CompactConfig
from gcl_core.data.formats import open_sequence
from gcl_core.errors import GclError
from gcl_ros.bag_info import look
from gcl_ros.bag_packing import pack_bag
from gcl_ros.fuzz import seeds


def bag(folder, storage='mcap'):
    """A whole bag."""
    path, (metadata, data) = folder / 'bag', seeds.bag(storage)
    path.mkdir()
    (path / 'metadata.yaml').write_bytes(metadata)
    (path / ('bag.mcap' if storage == 'mcap' else 'bag.db3')).write_bytes(data)
    return path


def edited(pattern, text):
    """A bag whose metadata.yaml is changed."""

    def change(path):
        metadata = path / 'metadata.yaml'
        found = re.sub(pattern, text, metadata.read_text(), count=1)
        assert found != metadata.read_text()
        metadata.write_text(found)
        return path

    return change


def without_metadata(path):
    (path / 'metadata.yaml').unlink()
    return path


def without_messages(path):
    next(file for file in path.iterdir() if file.suffix != '.yaml').unlink()
    return path


def its_file(path):
    return next(file for file in path.iterdir() if file.suffix != '.yaml')


def alone(path):
    return shutil.copy(its_file(path), path.parent / f'alone{its_file(path).suffix}')


def cut(path):
    file = its_file(path)
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    return path


def renamed(path):
    return its_file(path).rename(path / 'messages.bag')


def two_files(path):
    shutil.copy(its_file(path), path / f'second{its_file(path).suffix}')
    return without_metadata(path)


def packed_bag(path):
    """The same with compact scans; one voxel for each point, so small are they."""
    pack_bag(path, path.parent / 'packed', CompactConfig(voxel_size=0.01))
    return path.parent / 'packed'


def damaged_scans(path):
    """A packed bag in whose compact scans a bit is wrong, each in its own message."""
    file = its_file(packed_bag(path))
    data = file.read_bytes()
    places = [m.end() + 40 for m in re.finditer(rb'GCLS\x01', data)]
    assert len(places) == 4
    for place in places:
        data = data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
    file.write_bytes(data)
    return file.parent


BAGS = [
    ('folder', lambda path: path, ''),
    ('packed', packed_bag, ''),
    ('packed, file alone', lambda path: alone(packed_bag(path)), ''),
    ('packed, cut off', lambda path: cut(packed_bag(path)), 'cut off or damaged'),
    ('file in its folder', its_file, ''),
    ('file alone', alone, ''),
    ('folder without metadata.yaml', without_metadata, ''),
    ('file without metadata.yaml', lambda path: its_file(without_metadata(path)), ''),
    ('two files', two_files, r'2 files \.mcap or \.db3; .*`ros2 bag reindex .*/bag`'),
    (
        'cut off',
        cut,
        r'or damaged.*(`mcap recover .*bag\.mcap -o|`sqlite3 .*bag\.db3 \.r)',
    ),
    ('cut off, file', lambda path: its_file(without_metadata(cut(path))), 'cut off or damaged'),
    ('file missing', without_messages, r'are not there: .*`ros2 bag reindex .*/bag`'),
    ('of ROS 1', renamed, r'bag of ROS 1; `rosbags-convert --src .*messages\.bag --dst'),
    ('later version', edited(r'version: \d+', 'version: 10'), '10, which the installed rosbags'),
    ('other storage', edited(r'(storage_identifier): \w+', r'\1: other'), "as 'other'.* bag conv"),
    ('other serialization', edited('format: cdr', 'format: json'), 'as json.*`ros2 bag convert'),
    ('no count', edited(r'\n  message_count: \d+', ''), r'metadata\.yaml is damaged.*bag reindex'),
    ('no YAML', edited(r'(?s).*', '{'), r'metadata\.yaml is damaged; .*`ros2 bag reindex'),
    (
        'other compression',
        edited(
            r"compression_format: ''\n  compression_mode: ''",
            'compression_format: lz4\n  compression_mode: file',
        ),
        r"by 'lz4', of which only zstd is read.*`ros2 bag convert",
    ),
]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize(('make', 'words'), [case[1:] for case in BAGS], ids=[c[0] for c in BAGS])
def test_a_bag_is_opened_alike_by_info_and_inspect(make, words, storage, tmp_path):
    path = make(bag(tmp_path, storage))
    opens = look, lambda path: open_sequence(path, '/source/points').scan(1)
    if not words:
        assert look(path).messages == 6
        assert len(opens[1](path)) == len(seeds.cloud())
        return
    for opened in opens:
        with pytest.raises(GclError, match=words) as refused:
            opened(path)
        assert 'please report' not in str(refused.value)


def test_a_damaged_compact_scan_costs_itself_alone(tmp_path):
    """A bag is opened and told about; the scan whose bytes are wrong is refused by its frame."""
    path = damaged_scans(bag(tmp_path, 'sqlite3'))
    assert look(path).messages == 6
    drive = open_sequence(path, '/source/points')
    assert len(drive) == 2
    for index in range(2):
        with pytest.raises(GclError, match=r"'source/lidar' is damaged: .*copy it again"):
            drive.scan(index)
