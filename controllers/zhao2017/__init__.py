"""Zhao and Lee 2017: OA-FLC for danger and TO-FLC for the target."""
