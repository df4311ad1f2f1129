"""Motion model, Dubins paths and LQG-MP uncertainty."""
