"""Placeholder."""
def http(case): pass
def websocket(case): pass
