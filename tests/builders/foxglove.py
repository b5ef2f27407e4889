"""A client of Foxglove's protocol."""

import json

from websockets.sync.client import connect


def received(url, topics):
    """The first message of each topic received by the client; JSON is decoded."""
    found, names = {}, {}
    with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        while set(found) != set(topics):
            message = socket.recv(20.0)
            if isinstance(message, bytes):
                found.setdefault(names[int.from_bytes(message[1:5], "little")], message[13:])
                continue
            advertised = json.loads(message)
            if advertised["op"] == "advertise":
                available = {each["id"]: each["topic"] for each in advertised["channels"] if each["topic"] in topics}
                names |= available
                subscriptions = [{"id": number, "channelId": number} for number in available]
                socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
    return found
