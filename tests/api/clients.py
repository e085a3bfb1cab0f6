"""The test client, whichever HTTP library it finds."""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    # Starlette prefers httpx2 and says so at import; both work.
    warnings.simplefilter("ignore")
    from starlette.testclient import TestClient

__all__ = ["TestClient"]
