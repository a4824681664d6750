"""The action ``investigate`` of the discovery node: experiments that it has the excitation run."""
