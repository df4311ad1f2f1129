"""The aircraft that is simulated: JSBSim's flight dynamics, sensors, and the loops that steer it.

All randomness comes from given seeds, and all time is simulated. It is the only folder that uses JSBSim.
"""
