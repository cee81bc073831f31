"""The paper of 1999: its experiments, figures and claims, compared with our measurements."""
