"""The node of the live page: topics, parameters and actions on behalf of a browser."""
