"""The link between processes; `session` is the only module that touches zenoh."""

from daq.link.inbox import Inbox
from daq.link.session import (
    Declaration,
    Link,
    NoAnswer,
    NoAnswerInTime,
    Publisher,
    Refused,
    Request,
    Subscription,
)
from daq.link.settings import LinkError, free_ports, is_taken

__all__ = [
    "Declaration",
    "Inbox",
    "Link",
    "LinkError",
    "NoAnswer",
    "NoAnswerInTime",
    "Publisher",
    "Refused",
    "Request",
    "Subscription",
    "free_ports",
    "is_taken",
]
