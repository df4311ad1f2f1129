"""Mission transfers: our own uploads and downloads, MAVSDK's downloads, and observation of other transfers.

Code here waits by a given clock and sends by a given function. Only the reader imports MAVSDK, and only the
reader depends on the computer's clock.
"""
