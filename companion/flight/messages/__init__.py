"""What is heard and said beside a flight: frames of the vehicle's link, decisions told, and who looks on.

Touches the link and the recording; decides nothing.
"""
