-- Idempotency keys of jobs that are deleted.
CREATE TABLE kept_keys (
    owner text COLLATE "C" NOT NULL,
    idempotency_key text COLLATE "C" NOT NULL,
    until timestamptz NOT NULL,
    PRIMARY KEY (owner, idempotency_key)
);
CREATE INDEX kept_keys_until ON kept_keys (until);
