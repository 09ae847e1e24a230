"""Zhao and Lee 2018: the genes of an evolved OA-FLC."""
