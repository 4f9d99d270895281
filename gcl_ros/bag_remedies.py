"""What to do about a bag that rosbags does not read, in our words."""

from __future__ import annotations

import re
from pathlib import Path

SUFFIXES = ('.mcap', '.db3')  # of files that hold messages

# What rosbags says, what it means, and what helps; `{bag}` is the path, `{file}` of its messages.
REMEDIES = (
    (
        r'version (\d+) not supported',
        'its metadata.yaml is of version {0}, which the installed rosbags does not know: '
        '`pip install --upgrade rosbags`, or delete metadata.yaml and name the file of messages',
    ),
    (
        r'Storage plugin (\S+) not supported',
        'it is stored as {0}, of which only mcap and sqlite3 are read; write it anew with '
        '`ros2 bag convert -i {bag} -o OPTIONS.yaml`',
    ),
    (
        r'Compression format (\S+) is not supported',
        'it is compressed by {0}, of which only zstd is read; write it anew with '
        '`ros2 bag convert -i {bag} -o OPTIONS.yaml`',
    ),
    (
        r"Serialization format \{?'(.*)'\}? is not supported",
        'its messages are serialized as {0}, of which only cdr is read; write it anew with '
        '`ros2 bag convert -i {bag} -o OPTIONS.yaml`',
    ),
    (
        r'database files are missing: (.*)',
        'files that its metadata.yaml lists are not there: {0}; copy them beside it, or '
        '`ros2 bag reindex {bag}`',
    ),
    (
        r'YAML|metadata|No such file.*yaml|offered_qos',
        'its metadata.yaml is damaged; delete it and `ros2 bag reindex {bag}`',
    ),
    (
        r"Unrecognized storage format '\.bag'",
        'it is a bag of ROS 1; `rosbags-convert --src {bag} --dst FOLDER` makes one of ROS 2',
    ),
    (
        r"Unrecognized storage format '(.*)'",
        "a file '{0}' holds no messages of rosbag2; name a folder with metadata.yaml, or a file "
        '.mcap or .db3',
    ),
    (r'Profile is not ros2', 'its messages are not of ROS 2, but of another use of MCAP'),
    (
        r'seems to be empty|File magic',
        'it holds no MCAP data; its recorder wrote nothing, or it is of another format',
    ),
    (
        r'end magic|[Ff]ooter|summary offset|Truncated|[Cc]hunk|record|MCAP',
        'it is cut off or damaged, as where its recorder was killed; '
        '`mcap recover {file} -o recovered.mcap` saves what is whole',
    ),
    (
        r'database|sqlite',
        'it is cut off or damaged; `sqlite3 {file} .recover | sqlite3 recovered.db3` saves what '
        'is whole, and `ros2 bag reindex FOLDER` makes its metadata.yaml',
    ),
)


def storage_files(folder: Path) -> list[Path]:
    """Files of messages in a folder."""
    return sorted(path for path in folder.glob('*') if path.suffix in SUFFIXES)


def reason(error: BaseException, path: Path) -> str:
    """What is wrong with a bag, and what helps."""
    told = (str(error) or type(error).__name__)[:500]
    file = next(iter(storage_files(path)), path)
    for pattern, words in REMEDIES:
        found = re.search(pattern, told)
        if found:
            return words.format(*found.groups(), bag=path, file=file)
    return f'{told}; is it damaged or cut off?'
