-- State numbers are those of State::ALL: 0 waits, 1 runs, 2 and more are ends.
--
-- Texts that indexes order are of the collation "C": its order is that of their bytes, on every
-- system and in every version of it.
CREATE TABLE jobs (
    id uuid NOT NULL PRIMARY KEY,
    owner text COLLATE "C" NOT NULL,
    state smallint NOT NULL,
    attempt integer NOT NULL,
    -- Counts the claims: whoever has an older lease changes nothing.
    fence bigint NOT NULL,
    -- Of a job that runs: when its worker has fallen silent. Of one that waits: until when a node has
    -- set it aside, to make its last attempt alone.
    lease_end timestamptz,
    cancel_requested boolean NOT NULL,
    -- The client's word by which a repeated submission is known.
    word text COLLATE "C",
    -- What must be the same in a repeated submission.
    fingerprint bytea,
    order_query text NOT NULL,
    image_digest bytea NOT NULL,
    image_bytes bigint NOT NULL,
    image_shape text NOT NULL,
    stage text,
    fraction double precision,
    progress_at timestamptz,
    mesh text,
    mesh_digest bytea,
    problem text,
    created_at timestamptz NOT NULL,
    started_at timestamptz,
    finished_at timestamptz,
    expires_at timestamptz,
    revision bigint NOT NULL,
    -- The changes of state, four numbers each: revision, milliseconds since 1970, state, attempt.
    history bigint[] NOT NULL
);
-- Serves claims in turns of owners, the bounds of owners, leases that ended, and lists by any filter.
CREATE INDEX jobs_by_state ON jobs (state, owner, id);
CREATE INDEX jobs_waiting ON jobs (created_at) WHERE state = 0;
CREATE INDEX jobs_expiring ON jobs (expires_at) WHERE expires_at IS NOT NULL;
CREATE INDEX jobs_with_image ON jobs (image_digest) WHERE state < 2;
CREATE INDEX jobs_with_mesh ON jobs (mesh_digest) WHERE mesh_digest IS NOT NULL;
CREATE UNIQUE INDEX jobs_words ON jobs (owner, word) WHERE word IS NOT NULL;

-- Jobs that are no longer kept, and until when that is remembered.
CREATE TABLE gone (
    id uuid NOT NULL PRIMARY KEY,
    owner text COLLATE "C" NOT NULL,
    until timestamptz NOT NULL
);
CREATE INDEX gone_until ON gone (until);

-- What is locked while the jobs of an owner are counted: door 0 to come in, door 1 to be claimed.
CREATE TABLE doors (
    owner text COLLATE "C" NOT NULL,
    door smallint NOT NULL,
    PRIMARY KEY (owner, door)
);

-- How many jobs wait and run, as sums over rows: each transaction changes any one of them, so that few
-- wait for each other.
CREATE TABLE tallies (
    slot integer NOT NULL PRIMARY KEY,
    queued bigint NOT NULL,
    running bigint NOT NULL
);
INSERT INTO tallies SELECT slot, 0, 0 FROM generate_series(0, 63) AS slots (slot);

-- Blobs that a job had and gave up, or that were about to be stored.
CREATE TABLE given_up (
    blob bytea NOT NULL PRIMARY KEY,
    since timestamptz NOT NULL
);
CREATE INDEX given_up_since ON given_up (since);

-- What nodes tell each other: how long jobs take, and that the storage takes writes.
CREATE TABLE notes (
    name text NOT NULL PRIMARY KEY,
    value double precision NOT NULL,
    at timestamptz NOT NULL
);
