/* Counts what a rank sends, through the profiling interface of MPI: see messages.py, which preloads it. */
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>

static long long messages, bytes, sums, sum_bytes;

static void note(long long *calls, long long *sizes, int count, MPI_Datatype type) {
  int size;
  MPI_Type_size(type, &size);
  *calls += 1;
  *sizes += (long long)count * size;
}

int MPI_Isend(const void *data, int count, MPI_Datatype type, int to, int tag, MPI_Comm comm, MPI_Request *request) {
  note(&messages, &bytes, count, type);
  return PMPI_Isend(data, count, type, to, tag, comm, request);
}

/* Persistent requests: their sizes are noted when they are made, and counted when they are started. */
#define MOST 65536
static MPI_Request known[MOST];
static long long sizes[MOST];
static int made;

int MPI_Send_init(const void *data, int count, MPI_Datatype type, int to, int tag, MPI_Comm comm,
                  MPI_Request *request) {
  const int failed = PMPI_Send_init(data, count, type, to, tag, comm, request);
  int size;
  MPI_Type_size(type, &size);
  if (made < MOST) {
    known[made] = *request;
    sizes[made++] = (long long)count * size;
  }
  return failed;
}

int MPI_Startall(int count, MPI_Request *requests) {
  for (int i = 0; i < count; ++i) {
    for (int k = made - 1; k >= 0; --k) { /* handles are used again: the last one counts */
      if (known[k] == requests[i]) {
        messages += 1;
        bytes += sizes[k];
        break;
      }
    }
  }
  return PMPI_Startall(count, requests);
}

/* A receive may get the handle of a send that was freed. */
int MPI_Recv_init(void *data, int count, MPI_Datatype type, int from, int tag, MPI_Comm comm, MPI_Request *request) {
  const int failed = PMPI_Recv_init(data, count, type, from, tag, comm, request);
  for (int k = 0; k < made; ++k) {
    if (known[k] == *request) {
      known[k] = MPI_REQUEST_NULL;
    }
  }
  return failed;
}

int MPI_Allreduce(const void *in, void *out, int count, MPI_Datatype type, MPI_Op op, MPI_Comm comm) {
  note(&sums, &sum_bytes, count, type);
  return PMPI_Allreduce(in, out, count, type, op, comm);
}

int MPI_Iallreduce(const void *in, void *out, int count, MPI_Datatype type, MPI_Op op, MPI_Comm comm,
                   MPI_Request *request) {
  note(&sums, &sum_bytes, count, type);
  return PMPI_Iallreduce(in, out, count, type, op, comm, request);
}

int MPI_Finalize(void) {
  int rank;
  char name[4096];
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  snprintf(name, sizeof name, "%s.%d", getenv("LATIN_COUNTS"), rank);
  FILE *file = fopen(name, "w");
  if (file) {
    fprintf(file, "%lld %lld %lld %lld\n", messages, bytes, sums, sum_bytes);
    fclose(file);
  }
  return PMPI_Finalize();
}
