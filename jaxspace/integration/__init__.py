"""One integration: method, tolerances and save times resolved once, the loop, events, derivatives.
No physics."""
