"""A team: several aircraft that share their plans and need no leader.

``shared_plan`` is what they share, ``wire`` its bytes, ``agreement`` the rules by which a member takes a new
plan. Nothing here receives, sends or waits: bytes and the time come in as arguments, and bytes go out.
"""
