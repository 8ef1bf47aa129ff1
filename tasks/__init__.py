"""The labs, one script each; ``ctlabs list`` shows them."""
