"""Messages of a recording, by topic."""

from collections import defaultdict

from companion.recording.mcap_reader import messages_of


def read_messages(path, counters):
    found = defaultdict(list)
    for topic, document in messages_of(path, counters):
        found[topic].append(document)
    return dict(found)
