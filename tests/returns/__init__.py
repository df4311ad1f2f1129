"""Returns to launch at random moments of random maps, the service killed in half of them."""
