"""What people see: pictures of plans and missions, and the report of a flight."""
