"""Errors that a user may see. Each names the thing, the value found and the remedy."""


class HippomatError(Exception):
    """Base of every error that reaches a user as one line; `exit_code` is the process's answer."""

    exit_code = 1


class ConfigError(HippomatError):
    """A configuration that cannot be used; the message names file, key, value and range."""


class MapError(HippomatError):
    """A map that cannot be read; the message names the file and what is missing or wrong."""


class WireError(HippomatError, ValueError):
    """A value that does not fit the frame it was meant for."""


class ProtocolMismatch(HippomatError):
    """The other side of a link speaks another version of the protocol."""


class PortError(HippomatError):
    """A serial port that is missing, busy, or has another device behind it."""


class LogError(HippomatError):
    """A log that is damaged or lossy."""

    exit_code = 3
