"""The CAN bus: frames as arrays, the virtual bus and its python-can interface, ports for the loop, codec, capture."""
