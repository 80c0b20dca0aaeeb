"""Serves moto's S3 emulator to a client of Google Cloud Storage.

The XML API of Google Cloud Storage takes the same requests for objects as S3, but for a bearer
token in the place of a signature. moto reads signatures and does not check them.
"""

import sys

from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import run_simple

SIGNATURE = "AWS4-HMAC-SHA256 Credential=emulated/20260101/us-east-1/s3/aws4_request"

s3 = DomainDispatcherApplication(create_backend_app)


def with_signature(environ, start_response):
    return s3({**environ, "HTTP_AUTHORIZATION": SIGNATURE}, start_response)


run_simple("127.0.0.1", int(sys.argv[1]), with_signature, threaded=True)
