"""The aircraft that is simulated: JSBSim's flight dynamics, sensors, and the loops that steer it.

Draws chance from the seeds that it is given and goes by simulated time alone. The only folder that knows
JSBSim.
"""
