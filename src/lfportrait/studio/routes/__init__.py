"""What the page may ask for, one module for each of its screens.

A handler gets a `Call` and returns JSON, a status with JSON, or a response. Plain functions run in
a thread, as they read and write files; what has to do with jobs and processes is asynchronous.
"""
