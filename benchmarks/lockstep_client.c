// Copyright 2026 rb_sim contributors
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
// in compliance with the License. You may obtain a copy of the License at
// http://www.apache.org/licenses/LICENSE-2.0
// Unless required by applicable law or agreed to in writing, software distributed under the License
// is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
// or implied. See the License for the specific language governing permissions and limitations under
// the License.

/* Asks ~/advance of a node for one sample, again and again, each time when the answer is there.

   lockstep_client SERVICE COUNT WARM: prints how many requests per second were answered, the first
   WARM ones left out. Built and run by benchmarks/node_requests.py. */

#include <rcl/error_handling.h>
#include <rcl/graph.h>
#include <rcl/rcl.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "rb_sim_interfaces/srv/advance.h"

/* Libraries of the wheels want these of the Python that loads them; nothing here calls them. */
void *PyExc_RuntimeError, *_Py_NoneStruct, *_Py_TrueStruct, *_Py_FalseStruct;

#define PATIENCE RCL_S_TO_NS(120)

static void must(rcl_ret_t returned, const char * what)
{
  if (returned != RCL_RET_OK) {
    fprintf(stderr, "%s: %s\n", what, rcl_get_error_string().str);
    exit(1);
  }
}

static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void ask(
  rcl_client_t * client, rcl_wait_set_t * set, rb_sim_interfaces__srv__Advance_Response * answer)
{
  rb_sim_interfaces__srv__Advance_Request request;
  rb_sim_interfaces__srv__Advance_Request__init(&request);
  request.samples = 1;
  int64_t number;
  must(rcl_send_request(client, &request, &number), "send");
  rb_sim_interfaces__srv__Advance_Request__fini(&request);
  rcl_ret_t taken;
  rmw_service_info_t info;
  do {
    must(rcl_wait_set_clear(set), "clear");
    must(rcl_wait_set_add_client(set, client, NULL), "add");
    must(rcl_wait(set, PATIENCE), "wait");
    taken = rcl_take_response_with_info(client, &info, answer);
  } while (taken == RCL_RET_CLIENT_TAKE_FAILED);
  must(taken, "take");
  if (info.request_id.sequence_number != number || !answer->success || answer->samples != 1) {
    fprintf(stderr, "refused: %s\n", answer->message.data);
    exit(1);
  }
}

int main(int argc, char ** argv)
{
  if (argc != 4) {
    fprintf(stderr, "usage: lockstep_client SERVICE COUNT WARM\n");
    return 2;
  }
  const long count = atol(argv[2]), warm = atol(argv[3]);
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  must(rcl_init_options_init(&options, allocator), "options");
  rcl_context_t context = rcl_get_zero_initialized_context();
  must(rcl_init(0, NULL, &options, &context), "init");
  rcl_node_t node = rcl_get_zero_initialized_node();
  rcl_node_options_t node_options = rcl_node_get_default_options();
  node_options.enable_rosout = false;
  must(rcl_node_init(&node, "lockstep_client", "", &context, &node_options), "node");
  rcl_client_t client = rcl_get_zero_initialized_client();
  rcl_client_options_t client_options = rcl_client_get_default_options();
  const rosidl_service_type_support_t * type =
    ROSIDL_GET_SRV_TYPE_SUPPORT(rb_sim_interfaces, srv, Advance);
  must(rcl_client_init(&client, &node, type, argv[1], &client_options), "client");
  bool there = false;
  const double end = now() + 120.0;
  while (!there && now() < end) {
    must(rcl_service_server_is_available(&node, &client, &there), "server");
    nanosleep(&(struct timespec){0, 10000000}, NULL);
  }
  rcl_wait_set_t set = rcl_get_zero_initialized_wait_set();
  must(rcl_wait_set_init(&set, 0, 0, 0, 1, 0, 0, &context, allocator), "wait set");
  rb_sim_interfaces__srv__Advance_Response answer;
  rb_sim_interfaces__srv__Advance_Response__init(&answer);
  for (long k = 0; k < warm; ++k) {
    ask(&client, &set, &answer);
  }
  const double began = now();
  for (long k = 0; k < count; ++k) {
    ask(&client, &set, &answer);
  }
  printf("%.1f\n", count / (now() - began));
  return 0;
}
