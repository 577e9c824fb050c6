"""Errors a user can act on."""


class BridgeError(Exception):
    """Bad input or a missing peer: the text says which file or service, and what to do."""
