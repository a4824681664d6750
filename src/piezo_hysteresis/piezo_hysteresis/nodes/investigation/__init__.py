"""The action ``investigate`` of the discovery node: experiments run by the excitation."""
