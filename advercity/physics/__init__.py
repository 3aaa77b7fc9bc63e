"""From authored weather to extinction, sky and light."""
