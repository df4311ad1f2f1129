"""Coming down without thrust: the fields within reach, the mission to one, and stretches without any.

It uses the model of the glide and the independent check; it neither waits nor speaks.
"""
