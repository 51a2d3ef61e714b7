"""An oracle for ROSMonitoring: monitors behind a WebSocket, one JSON event per message, one reply each.

`names` lets topics match with and without their leading slash, `session` is what one connection has read, `protocol` says what
a message is answered, `hosts` what may be named as a host, `origins` whose connections are taken, `server` does the input and output.
"""
